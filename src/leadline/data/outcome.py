"""What became of a measurement: an enumeration whose members are sentences."""

from __future__ import annotations

from enum import IntEnum


class Outcome(IntEnum):
    """The fate of one row; kernels hold the number, a person reads the sentence.

    Trouble at sea is never an exception: it is an outcome, recorded at its row and counted in the summary.
    """

    USED = 0, "was used"
    GATED = 1, "its residual lies outside the gate"
    INVALID = 2, "is not a number, is incomplete, or the sensor itself calls it invalid"
    OUT_OF_RANGE = 3, "lies outside what the instrument can measure"
    DUPLICATE = 4, "equals another row in all columns"
    HELD = 5, "repeats a value that the sensor holds between measurements"
    LATE = 6, "arrived after the window of the navigator had closed"
    CLOCK_JUMP = 7, "its time steps backward against the order of arrival, or its clock has only just stepped"
    NOT_CONFIGURED = 8, "the vehicle file does not name this sensor"
    OUTSIDE_RUN = 9, "lies before the start or after the end of the run"
    NO_CLONE = 10, "the pose at its earlier epoch is not available"
    NO_MODEL = 11, "no model uses this kind of sensor yet"
    EXCLUDED = 12, "was left out on request"
    REANCHORED = 13, "was used after a run of rejections: the estimate was opened up along its residual"
    STANDBY = 14, "stands by: the instrument that it stands in for is at work"
    DECIMATED = 15, "follows the last one sooner than the vehicle file asks for"
    OVERRULED = 16, "was turned away by the smoother: the data before and after it speak against it"

    sentence: str

    def __new__(cls, value: int, sentence: str = "") -> Outcome:
        """Make a member that is an integer and carries a sentence."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.sentence = sentence
        return member
