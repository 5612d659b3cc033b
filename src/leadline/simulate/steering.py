"""How a simulated vehicle is steered, compiled: along a route by line of sight, to a depth, with cascaded loops and anti-windup.

    progress   where on the route the vehicle is, and whether a stay begins or ends
    aim        the point `lookahead` metres further along (Fossen, 2021, section 12.4): the course leads there
    demand     velocities wanted: surge, sway, heave, pitch rate, yaw rate; between P loops around them and PI loops on them
    allocate   forces to thrusters by a weighted pseudo-inverse, moments to fins by the square of the speed

Current is met where it is felt.  A vehicle that can push sideways holds velocities over ground; one that cannot turns its bow into the
current by the angle between course and heading.  An integral stops while what it asks for cannot be given.

All that the pilot sees is `nav`: time, north, east, depth, altitude (nan: not known), roll, pitch, heading, velocity north, east and down,
rates about x, y and z.  That is the truth, or what a navigator believes.
"""

from __future__ import annotations

import math

from leadline.core.compiled import kernel
from leadline.core.gaussian import wrapped
from leadline.simulate.routes import ALONG, ALTITUDE, EAST, HEADING, HOLD, LEG, NORTH, SPEED, TURN, VERTICAL

NAV = 14
# Memory of the pilot.
(SEGMENT, PROGRESS, STAY_FROM, CRAB, DEPTH_WANTED, SPEED_WANTED, HEADING_WANTED, MODE, MODE_FROM, DIVED, DONE, HELD_NORTH, HELD_EAST,
 TURN_FROM, BEST, BEST_FROM, BUOYANCY, FIRST, AT_LEG, PITCH_WANTED, AT_DEPTH, TARGET, NEAREST,
 HIGHEST, WAITS) = range(25)  # fmt: skip
INTEGRAL, FULL = 25, 31  # six integrals; six flags: what was asked of that axis could not be given
MEMORY = 37
UNDER_WAY, RISING, UP, LAST_RISE, LAST_UP = 0.0, 1.0, 2.0, 3.0, 4.0
NEVER = -1e8  # s: what lies before it has not happened

# The array `pilot`: settings, then six numbers for each axis, then the allocation.
(LOOKAHEAD, ARRIVE, ACCELERATION, DESCENT, PITCH_MAX, TURN_MAX, SWAY, HEAVE, SPINS, EVERY, STAY, STOP, ASCEND, AT_END, AFLOAT,
 KEEL, THRUSTERS, FINS, SIDE_MAX, DEEPEST) = range(20)  # fmt: skip
AXES, AXIS = 20, 7  # mass, bandwidth and outer gain (1/s), linear and quadratic drag, largest force, integral (of the bandwidth)
ALLOCATION = AXES + 6 * AXIS  # thrusters x 6, then ahead, astern, most, dead band of each, then fins x 2 and most of each
LEASH, AT_LEVEL = 2.0, 0.5  # m: how far the wanted depth runs ahead of the hull; from where on a depth is reached
SHARP = 0.5  # cosine of the angle from which on a corner is not cut
SURGE, SIDE, VERTICALLY, ROLL, PITCH, YAW = range(6)


@kernel()
def limited(value, most):
    """A value between -most and most."""
    return min(max(value, -most), most)


@kernel()
def corner(route, k):
    """Cosine of the angle by which the route turns at row k."""
    a0, a1 = route[k, NORTH] - route[k - 1, NORTH], route[k, EAST] - route[k - 1, EAST]
    b0, b1 = route[k + 1, NORTH] - route[k, NORTH], route[k + 1, EAST] - route[k, EAST]
    size = math.sqrt((a0 * a0 + a1 * a1) * (b0 * b0 + b1 * b1))
    return (a0 * b0 + a1 * b1) / size if size > 0.0 else 1.0


@kernel()
def stops(route, k):
    """Whether the way ends at row k for now: a stay, a sharp corner, the last row."""
    return k == len(route) - 1 or route[k, HOLD] > 0.0 or corner(route, k) < SHARP


@kernel()
def ends(route, k):
    """Whether the vehicle stays at row k, or the plan ends there."""
    return k == len(route) - 1 or route[k, HOLD] > 0.0


@kernel()
def level_with(nav, pilot, memory):
    """Whether the wanted depth is reached; a hull that must keep moving does not wait for it."""
    return pilot[HEAVE] == 0.0 or abs(memory[TARGET] - nav[3]) < AT_LEVEL


@kernel()
def progress(nav, route, pilot, memory):
    """Move on along the route."""
    n, e, time = nav[1], nav[2], nav[0]
    if memory[FIRST] == 0.0:
        memory[FIRST], memory[SEGMENT], memory[STAY_FROM], memory[DONE], memory[BEST_FROM] = 1.0, 1.0, -1e9, -1e9, time
        memory[TARGET], memory[NEAREST], memory[HIGHEST], memory[AT_DEPTH] = math.nan, math.inf, nav[3], time
        memory[SPEED_WANTED] = max(nav[8] * math.cos(nav[7]) + nav[9] * math.sin(nav[7]), 0.0)
        memory[DEPTH_WANTED], memory[HEADING_WANTED], memory[DIVED], memory[HELD_NORTH], memory[HELD_EAST] = nav[3], nav[7], time, n, e
    while memory[DONE] < NEVER:
        k = int(memory[SEGMENT])
        a0, a1, b0, b1 = route[k - 1, NORTH], route[k - 1, EAST], route[k, NORTH], route[k, EAST]
        length = route[k, ALONG] - route[k - 1, ALONG]
        t = ((n - a0) * (b0 - a0) + (e - a1) * (b1 - a1)) / length if length > 0.0 else length
        memory[PROGRESS] = route[k - 1, ALONG] + min(max(t, 0.0), length)
        memory[AT_LEG] = route[k, LEG]
        near = math.sqrt((n - b0) ** 2 + (e - b1) ** 2) < pilot[ARRIVE]
        reached = near or (t >= length and not (route[k, HOLD] > 0.0))
        memory[WAITS] = 0.0
        if memory[STAY_FROM] < NEVER and not reached:
            break
        if memory[STAY_FROM] < NEVER and ends(route, k) and not level_with(nav, pilot, memory):
            memory[WAITS], memory[HELD_NORTH], memory[HELD_EAST], memory[BEST_FROM] = 1.0, b0, b1, time
            break
        if route[k, HOLD] > 0.0:
            if memory[STAY_FROM] < NEVER:
                memory[STAY_FROM], memory[TURN_FROM] = time, memory[HEADING_WANTED]
            memory[HELD_NORTH], memory[HELD_EAST], memory[BEST_FROM] = b0, b1, time
            if time - memory[STAY_FROM] < route[k, HOLD]:
                break
            memory[STAY_FROM] = -1e9
        if k == len(route) - 1:
            memory[DONE] = time
            memory[HELD_NORTH], memory[HELD_EAST] = b0, b1
        else:
            memory[SEGMENT] = k + 1.0
    if memory[PROGRESS] > memory[BEST] + 0.5 or memory[MODE] in (UP, LAST_UP):
        memory[BEST], memory[BEST_FROM] = max(memory[PROGRESS], memory[BEST]), time
    rises = memory[MODE] in (RISING, LAST_RISE)
    if not rises or nav[3] < memory[HIGHEST] - 0.5:  # on the way up, what is gained in height counts
        memory[HIGHEST] = nav[3]
        memory[BEST_FROM] = time if rises else memory[BEST_FROM]


@kernel()
def aim(route, pilot, memory):
    """Point to steer for: north, east, and how far it is along the route to where the way ends for now."""
    k = int(memory[SEGMENT])
    left = memory[PROGRESS] + pilot[LOOKAHEAD]
    while left > route[k, ALONG] and not stops(route, k):
        k += 1
    length = route[k, ALONG] - route[k - 1, ALONG]
    share = (left - route[k - 1, ALONG]) / length if length > 0.0 else 1.0  # beyond a stop the line is drawn out
    last = k
    while not stops(route, last):
        last += 1
    north = route[k - 1, NORTH] + share * (route[k, NORTH] - route[k - 1, NORTH])
    return north, route[k - 1, EAST] + share * (route[k, EAST] - route[k - 1, EAST]), route[last, ALONG] - memory[PROGRESS]


@kernel()
def rise(nav, pilot, memory):
    """Whether the vehicle goes to the surface, stays there, or is under way."""
    time, up = nav[0], nav[3] <= pilot[AFLOAT]
    if memory[DONE] > NEVER and memory[MODE] < LAST_RISE:
        memory[MODE], memory[MODE_FROM] = (LAST_RISE, time) if pilot[ASCEND] > 0.0 else (LAST_UP, time)
    if memory[MODE] == UNDER_WAY and pilot[EVERY] > 0.0 and time - memory[DIVED] >= pilot[EVERY] and memory[DONE] < NEVER:
        memory[MODE], memory[HELD_NORTH], memory[HELD_EAST] = RISING, nav[1], nav[2]
    elif memory[MODE] == RISING and up:
        memory[MODE], memory[MODE_FROM] = UP, time
    elif memory[MODE] == UP and time - memory[MODE_FROM] >= pilot[STAY]:
        memory[MODE], memory[DIVED] = UNDER_WAY, time
    elif memory[MODE] == LAST_RISE and up:
        memory[MODE], memory[MODE_FROM] = LAST_UP, time


@kernel()
def depth_wanted(nav, route, pilot, memory, dt):
    """Move the wanted depth on, and return the rate at which it moves."""
    k = int(memory[SEGMENT])
    target = route[k, VERTICAL]
    if route[k, ALTITUDE] > 0.0:
        known = nav[4] == nav[4]
        target = nav[3] + nav[4] - route[k, VERTICAL] if known else memory[DEPTH_WANTED]
        target = min(max(target, pilot[KEEL]), pilot[DEEPEST])
    if memory[MODE] in (RISING, UP, LAST_RISE) or (memory[MODE] == LAST_UP and pilot[ASCEND] > 0.0):
        target = -pilot[KEEL] - 0.3  # as high as it floats
    if not abs(target - memory[TARGET]) < 1.0:  # another one, or the first
        memory[NEAREST], memory[AT_DEPTH] = math.inf, nav[0]
    memory[TARGET] = target
    if abs(target - nav[3]) < memory[NEAREST] - 0.5:
        memory[NEAREST], memory[AT_DEPTH] = abs(target - nav[3]), nav[0]
    before = memory[DEPTH_WANTED]
    after = before + limited(target - before, pilot[DESCENT] * dt)
    memory[DEPTH_WANTED] = min(max(after, nav[3] - LEASH), nav[3] + LEASH)
    return limited((memory[DEPTH_WANTED] - before) / dt, pilot[DESCENT])


@kernel()
def course(nav, route, pilot, memory):
    """Direction (rad) and speed (m/s) wanted over ground."""
    k = int(memory[SEGMENT])
    stopped = memory[MODE] in (RISING, UP) and pilot[STOP] > 0.0
    if memory[DONE] > NEVER and pilot[SPINS] == 0.0:  # straight on until it is up
        return memory[HEADING_WANTED], route[k, SPEED] if memory[MODE] == LAST_RISE else 0.0
    if stays(memory) or stopped:
        d0, d1 = memory[HELD_NORTH] - nav[1], memory[HELD_EAST] - nav[2]
        return math.atan2(d1, d0), min(0.25 * math.sqrt(d0 * d0 + d1 * d1), route[k, SPEED])
    north, east, left = aim(route, pilot, memory)
    speed = route[k, SPEED]
    if pilot[SPINS] > 0.0:  # it can stop: slow down before a stop that it must not overrun
        speed = min(speed, 0.05 + 0.3 * max(left, 0.0))
    return math.atan2(east - nav[2], north - nav[1]), speed


@kernel()
def heading_wanted(nav, route, pilot, memory, direction, dt):
    """Heading (rad) wanted: along the course and into the current, fixed, or turning on the spot; limited in rate."""
    k = int(memory[SEGMENT])
    ground = math.sqrt(nav[8] * nav[8] + nav[9] * nav[9])
    if pilot[SWAY] == 0.0:
        angle = wrapped(math.atan2(nav[9], nav[8]) - nav[7]) if ground > 0.3 else 0.0
        memory[CRAB] += min(dt / 5.0, 1.0) * (limited(angle, 1.0) - memory[CRAB])
    target = direction - memory[CRAB]
    away = math.sqrt((memory[HELD_NORTH] - nav[1]) ** 2 + (memory[HELD_EAST] - nav[2]) ** 2)
    held = stays(memory)
    if memory[STAY_FROM] > NEVER and route[k, TURN] != 0.0:
        target = memory[TURN_FROM] + route[k, TURN] * min((nav[0] - memory[STAY_FROM]) / route[k, HOLD], 1.0)
        memory[HEADING_WANTED] = target
        return target
    if route[k, HEADING] == route[k, HEADING]:
        target = route[k, HEADING]
    elif held and (pilot[SWAY] > 0.0 or away < pilot[ARRIVE]):
        target = memory[HEADING_WANTED]
    memory[HEADING_WANTED] += limited(wrapped(target - memory[HEADING_WANTED]), 1.5 * pilot[TURN_MAX] * dt)
    return memory[HEADING_WANTED]


@kernel()
def loop(pilot, memory, axis, wanted, found, dt):
    """Force (N, N m) of one axis: wanted acceleration times mass, drag at the wanted velocity, and an integral."""
    at = AXES + AXIS * axis
    mass, band, most = pilot[at], pilot[at + 1], pilot[at + 5]
    error = wanted - found
    if memory[FULL + axis] == 0.0 or memory[FULL + axis] * error < 0.0:
        memory[INTEGRAL + axis] = limited(memory[INTEGRAL + axis] + pilot[at + 6] * mass * band * band * error * dt, most)
    return mass * band * error + (pilot[at + 3] + pilot[at + 4] * abs(wanted)) * wanted + memory[INTEGRAL + axis]


@kernel()
def stays(memory):
    """Whether the vehicle is to be in one place."""
    return memory[STAY_FROM] > NEVER or memory[DONE] > NEVER or memory[WAITS] > 0.0


@kernel()
def demand(nav, route, pilot, memory, dt, force):
    """Write the generalised force (6,) that is wanted."""
    direction, speed = course(nav, route, pilot, memory)
    memory[SPEED_WANTED] += limited(speed - memory[SPEED_WANTED], pilot[ACCELERATION] * dt)
    heading = heading_wanted(nav, route, pilot, memory, direction, dt)
    climb = depth_wanted(nav, route, pilot, memory, dt)
    cp, sp, ch, sh = math.cos(nav[6]), math.sin(nav[6]), math.cos(nav[7]), math.sin(nav[7])
    level = nav[8] * ch + nav[9] * sh
    surge, sway = cp * level - sp * nav[10], -nav[8] * sh + nav[9] * ch
    heave = sp * level + cp * nav[10]
    wanted = memory[SPEED_WANTED]
    error = wrapped(heading - nav[7])
    k = int(memory[SEGMENT])
    sideways = pilot[SWAY] > 0.0 and (stays(memory) or route[k, HEADING] == route[k, HEADING])
    if sideways:
        ahead, aside = wanted * math.cos(direction - nav[7]), limited(wanted * math.sin(direction - nav[7]), pilot[SIDE_MAX])
    else:  # the bow leads; a hull that is pushed sideways while it turns would be turned further
        ahead, aside = wanted * (max(math.cos(error), 0.0) if pilot[SPINS] > 0.0 else 1.0), 0.0
    down = limited(pilot[AXES + AXIS * VERTICALLY + 2] * (memory[DEPTH_WANTED] - nav[3]) + climb, 1.2 * pilot[DESCENT])
    force[SURGE] = loop(pilot, memory, SURGE, ahead, surge, dt)
    force[SIDE] = loop(pilot, memory, SIDE, aside, sway, dt) if pilot[SWAY] > 0.0 else 0.0
    pitch, pitch_error = 0.0, memory[PITCH_WANTED] - nav[6]
    if pilot[HEAVE] > 0.0:
        force[VERTICALLY] = loop(pilot, memory, VERTICALLY, (down + sp * level) / max(cp, 0.5), heave, dt)
    else:
        force[VERTICALLY] = 0.0
        lag = memory[DEPTH_WANTED] - nav[3]
        if memory[MODE] == UNDER_WAY and abs(lag) < 1.0 and abs(pitch_error) < 0.1:  # on the slope that it wants, and near
            memory[BUOYANCY] = limited(memory[BUOYANCY] + 0.01 * lag * dt, 0.2)
        high = memory[MODE] != UNDER_WAY and nav[3] <= pilot[AFLOAT]
        pitch = 0.0 if high else -limited(math.asin(limited(down / max(surge, 0.5), 0.9)) + memory[BUOYANCY], pilot[PITCH_MAX])
    memory[PITCH_WANTED] = pitch
    outer = pilot[AXES + AXIS * PITCH + 2] * (pitch - nav[6])
    force[ROLL] = loop(pilot, memory, ROLL, limited(-pilot[AXES + AXIS * ROLL + 2] * nav[5], 0.5), nav[11], dt)
    force[PITCH] = loop(pilot, memory, PITCH, limited(outer, 0.5), nav[12], dt)
    turn = 0.0
    if memory[STAY_FROM] > NEVER and route[int(memory[SEGMENT]), TURN] != 0.0:
        k = int(memory[SEGMENT])
        turn = route[k, TURN] / route[k, HOLD]
    force[YAW] = loop(pilot, memory, YAW, limited(pilot[AXES + AXIS * YAW + 2] * error + turn, pilot[TURN_MAX]), nav[13], dt)
    return max(surge, 0.5)


@kernel()
def turned_off(force, most):
    """Sign of what was asked beyond what can be given; 0: all can be given."""
    return 0.0 if abs(force) <= most else math.copysign(1.0, force)


@kernel()
def thrusts(pilot, row, force):
    """Thrust (N) of one thruster for heave and the moments, and for surge and sway."""
    first = pilot[row + VERTICALLY] * force[VERTICALLY] + pilot[row + ROLL] * force[ROLL]
    first += pilot[row + PITCH] * force[PITCH] + pilot[row + YAW] * force[YAW]
    return first, pilot[row + SURGE] * force[SURGE] + pilot[row + SIDE] * force[SIDE]


@kernel()
def allocate(pilot, memory, force, surge, command):
    """Write the speeds of the thrusters (rps) and the angles of the fins (rad) that give the force, as far as they can."""
    count, fins = int(pilot[THRUSTERS]), int(pilot[FINS])
    for axis in range(6):
        most = pilot[AXES + AXIS * axis + 5]
        memory[FULL + axis] = turned_off(force[axis], most)
        force[axis] = limited(force[axis], most)
    rows, laws = ALLOCATION, ALLOCATION + 6 * count
    share = 1.0  # of surge and sway, so that what turns the vehicle and moves it up and down is given first
    for i in range(count):
        first, level = thrusts(pilot, rows + 6 * i, force)
        room = min(pilot[laws + 4 * i], pilot[laws + 4 * i + 1]) * pilot[laws + 4 * i + 2] ** 2
        if abs(first + level) > room and level != 0.0:
            share = min(share, max((room - first if level > 0.0 else -room - first) / level, 0.0))
    if share < 1.0:
        memory[FULL + SURGE], memory[FULL + SIDE] = math.copysign(1.0, force[SURGE]), math.copysign(1.0, force[SIDE])
    for i in range(count):
        first, level = thrusts(pilot, rows + 6 * i, force)
        thrust = first + share * level
        ahead, astern, most, dead = pilot[laws + 4 * i], pilot[laws + 4 * i + 1], pilot[laws + 4 * i + 2], pilot[laws + 4 * i + 3]
        speed = math.sqrt(thrust / ahead) if thrust >= 0.0 else -math.sqrt(-thrust / astern)
        command[i] = limited(speed, most) if abs(speed) >= 0.5 * dead else 0.0
        if 0.5 * dead <= abs(speed) < dead:
            command[i] = math.copysign(dead, speed)
    at = laws + 4 * count
    for j in range(fins):
        most = pilot[at + 3 * j + 2]
        angle = (pilot[at + 3 * j] * force[PITCH] + pilot[at + 3 * j + 1] * force[YAW]) / (surge * surge)
        command[count + j] = limited(angle, most)
        if abs(angle) > most:
            for axis, share in ((PITCH, pilot[at + 3 * j]), (YAW, pilot[at + 3 * j + 1])):
                if share != 0.0 and share * force[axis] * angle > 0.0:
                    memory[FULL + axis] = math.copysign(1.0, force[axis])


@kernel()
def steer(nav, route, pilot, memory, dt, force, command):
    """Write the command that follows the route from what `nav` says; `dt` s since the last time."""
    progress(nav, route, pilot, memory)
    rise(nav, pilot, memory)
    surge = demand(nav, route, pilot, memory, dt, force)
    allocate(pilot, memory, force, surge, command)


@kernel()
def finished(time, pilot, memory):
    """Whether the plan is at its end, with its last stay."""
    return memory[MODE] == LAST_UP and time - memory[MODE_FROM] >= pilot[AT_END]
