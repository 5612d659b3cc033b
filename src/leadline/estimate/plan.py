"""Where things lie in the integer array `plan`, the compiled form of a composition; its head belongs to models/layout.py."""

from leadline.core.compiled import NUISANCES, SLOT_NUISANCE
from leadline.models.layout import LAYOUT_END
from leadline.models.view import VIEW_SIZE

# Addresses of machine code, and ranges in `params`; FIELDS: how many nuisances change with the distance travelled.
# SETTLE_AT is 0 where an estimator has nothing to settle; ROOT: whether the covariance's place holds its root; ESTIMATOR: its parameters.
STEP_AT, PUSH_AT, NOISE_AT, VIEW_AT, PULL_AT, PROPAGATE_AT, POINTS_AT, UPDATE_AT, SETTLE_AT = range(LAYOUT_END, LAYOUT_END + 9)
MOTION_PARAMS, MOTION_END, DECAY_PARAMS, LONGEST_STEP, FIELDS, ROOT, ESTIMATOR = range(LAYOUT_END + 9, LAYOUT_END + 16)
CHANNEL, CHANNEL_SIZE = LAYOUT_END + 16, SLOT_NUISANCE + NUISANCES

# Parameters that every estimator has: whether noise of measurements and of the motion is learnt, and over how many measurements.
ADAPT_R, ADAPT_Q, MEMORY_E, OWN_E = range(4)  # then its own

# Parameters of each nuisance, from DECAY_PARAMS on: decay and driving variance per second, and per metre travelled; what it decays to.
DECAY, DENSITY, DECAY_PER_METRE, DENSITY_PER_METRE, MEAN, DECAY_SIZE = range(6)

# One row per channel, from CHANNEL on: what the loop and the estimators must know of it.
(SENSOR_AT, PARAMS, PARAMS_END, COMPONENTS_N, ANGLES, EPOCHS, VALUES_N, VALUES, GATE) = range(9)  # then SLOT_NUISANCE: index or -1
# The channels of the sensor that this one stands in for; whether its views are displaced, and the states that displace them, or -1.
STANDBY_FIRST, STANDBY_END, DISPLACED, TIME_S, OFFSET_S, DRIFT_S, LEVER_S = range(9, 16)

# Parameters of a channel's gate, from GATE on; then what displaces its views where no state does.
(LIMIT, WIDENING, STUDENT_DOF, REANCHOR_AFTER, EVERY, STANDBY_AFTER, NOISE_FACTOR) = range(7)
TIME_P, OFFSET_P, DRIFT_P, LEVER_P, GATE_SIZE = 7, 8, 9, 10, 13

# Kinds of event that are no channel.
IS_INPUT, IS_OUTPUT, IS_CLONE, IS_DROP = -1, -2, -3, -4

# What an update leaves in `result`; VERDICT is asked for: ADMIT leaves the gate open for this row.
NIS, RESIDUAL, SIGMA, LOG_DET, WIDENED, VERDICT, RESULT_SIZE = 0, 1, 9, 17, 18, 19, 20
ADMIT = 1.0
# What one output holds: view, packed covariance of position, velocity, attitude; then x and the variances of its errors.
OUT_VIEW, OUT_COV, OUT_X = 0, VIEW_SIZE, VIEW_SIZE + 45
