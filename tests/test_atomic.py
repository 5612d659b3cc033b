"""Output is whole or not there, and nobody's own folder is destroyed."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from leadline.data.errors import InputError
from leadline.formats.atomic import check_place, new_file, new_folder


def tree(path: Path) -> list[str]:
    return sorted(str(p.relative_to(path)) for p in path.rglob("*"))


def fill(folder: Path, marker: str = "summary.json") -> None:
    (folder / marker).write_text("{}")
    (folder / "a.csv").write_text("1")


def test_a_file_appears_when_it_is_whole(tmp_path: Path) -> None:
    with new_file(tmp_path / "deep" / "x.json") as part:
        part.write_text("1")
        assert not (tmp_path / "deep" / "x.json").exists()
        assert part.suffix == ".json"
    assert tree(tmp_path) == ["deep", "deep/x.json"]
    with new_file(tmp_path / "deep" / "x.json") as part:
        part.write_text("2")
    assert (tmp_path / "deep" / "x.json").read_text() == "2"


def test_a_folder_appears_when_it_is_whole(tmp_path: Path) -> None:
    with new_folder(tmp_path / "out") as part:
        fill(part)
        assert not (tmp_path / "out").exists()
    assert tree(tmp_path) == ["out", "out/a.csv", "out/summary.json"]
    with new_folder(tmp_path / "out") as part:
        (part / "summary.json").write_text("new")
    assert tree(tmp_path) == ["out", "out/summary.json"]
    assert (tmp_path / "out").stat().st_mode & 0o500 == 0o500


def work_that_fails(path: Path, raised: type[BaseException]) -> None:
    with new_folder(path) as part:
        fill(part)
        raise raised


def file_that_fails(path: Path, raised: type[BaseException]) -> None:
    with new_file(path) as part:
        part.write_text("half")
        raise raised


@pytest.mark.parametrize("raised", [ValueError, KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize("work", [work_that_fails, file_that_fails])
def test_nothing_is_left_when_the_work_fails(tmp_path: Path, work, raised: type[BaseException]) -> None:
    with pytest.raises(raised):
        work(tmp_path / "out", raised)
    assert tree(tmp_path) == []


def test_the_old_result_stays_when_the_work_fails(tmp_path: Path) -> None:
    with new_folder(tmp_path / "out") as part:
        fill(part)
    before = tree(tmp_path)
    with pytest.raises(KeyboardInterrupt), new_folder(tmp_path / "out"):
        raise KeyboardInterrupt
    assert tree(tmp_path) == before


def test_a_full_disk_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"out: cannot be written: No space left on device") as caught, new_folder(tmp_path / "out"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"x\.json: cannot be written: Permission denied"), new_file(tmp_path / "x.json"):
        raise PermissionError(errno.EACCES, "Permission denied")
    assert tree(tmp_path) == []


def test_a_place_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"), new_folder(tmp_path / "file" / "out"):
        pass
    with pytest.raises(InputError, match="is a file"), new_folder(tmp_path / "file"):
        pass
    with pytest.raises(InputError, match="is a folder"), new_file(tmp_path):
        pass


@pytest.mark.parametrize("foreign", ["thesis.txt", "photos/1.csv"])
def test_a_folder_with_anything_foreign_is_not_replaced(tmp_path: Path, foreign: str) -> None:
    out = tmp_path / "out"
    (out / foreign).parent.mkdir(parents=True)
    (out / foreign).write_text("mine")
    for _ in range(2):  # without the marker, and with it
        with pytest.raises(InputError, match=r"name a new or an empty folder"), new_folder(out):
            pytest.fail("the work must not start")
        fill(out)
    assert (out / foreign).read_text() == "mine"


def test_a_solution_never_takes_the_place_of_a_log(tmp_path: Path) -> None:
    fill(tmp_path, "log.toml")
    with pytest.raises(InputError, match=r"holds no summary\.json"):
        check_place(tmp_path)
    check_place(tmp_path, "log.toml")
    check_place(tmp_path / "new")


def test_a_folder_that_changes_hands_meanwhile_is_kept(tmp_path: Path) -> None:
    def work() -> None:
        with new_folder(tmp_path / "out") as part:
            fill(part)
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "thesis.txt").write_text("mine")

    with pytest.raises(InputError, match="exists"):
        work()
    assert tree(tmp_path) == ["out", "out/thesis.txt"]
