"""Where things lie in the integer array `plan`, the compiled form of a composition; its head belongs to models/layout.py."""

from leadline.core.compiled import NUISANCES, SLOT_NUISANCE
from leadline.models.layout import LAYOUT_END
from leadline.models.view import VIEW_SIZE

# Addresses of machine code, and ranges in `params`.
STEP_AT, PUSH_AT, NOISE_AT, VIEW_AT, PULL_AT, PROPAGATE_AT, POINTS_AT, UPDATE_AT = range(LAYOUT_END, LAYOUT_END + 8)
MOTION_PARAMS, MOTION_END, DECAY_PARAMS, LONGEST_STEP = range(LAYOUT_END + 8, LAYOUT_END + 12)
CHANNEL, CHANNEL_SIZE = LAYOUT_END + 12, SLOT_NUISANCE + NUISANCES

# One row per channel, from CHANNEL on: what the loop and the estimators must know of it.
(SENSOR_AT, PARAMS, PARAMS_END, COMPONENTS_N, ANGLES, EPOCHS, VALUES_N, VALUES, GATE) = range(9)  # then SLOT_NUISANCE: index or -1

# Kinds of event that are no channel.
IS_INPUT, IS_OUTPUT, IS_CLONE, IS_DROP = -1, -2, -3, -4

# What an update leaves in `result`.
NIS, RESIDUAL, SIGMA, RESULT_SIZE = 0, 1, 9, 17
# What one output holds: view, packed covariance of position, velocity, attitude; then x and the variances of its errors.
OUT_VIEW, OUT_COV, OUT_X = 0, VIEW_SIZE, VIEW_SIZE + 45
