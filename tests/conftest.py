"""Examples drawn at random are the same in every run, and the first call of a kernel may take its time."""

from hypothesis import settings

settings.register_profile("leadline", deadline=None, derandomize=True)
settings.load_profile("leadline")
