"""Rays of sound between two depths in layers whose speed of sound is linear in depth, compiled.

With the ray parameter p = cos(elevation) / c, the same along the whole ray, each layer is an arc of a circle.  Between its ends, where
the speeds are c1, c2 and the sines of the elevation s1, s2 (s = sqrt(1 - p^2 c^2)), h apart in depth, with the gradient g:

    horizontal  x = p (c1 + c2) h / (s1 + s2)
    time        t = atanh(g w) / g,            w = h (c1 + c2) (1 + s1 s2) / ((s1 + s2) (c1^2 + c2^2 - p^2 c1^2 c2^2))
    length      l = asin(p g u) / (p g),       u = h (c1 + c2) / (s1 c2 + c1 s2)

the textbook forms (Jensen et al., Computational Ocean Acoustics, 2011, chapter 3) with all differences of nearly equal numbers taken out,
so that g = 0 is an ordinary place.  Two families of rays are searched: those that go from one depth to the other without turning, by
Newton in 1/q with q the cotangent of the elevation where sound is fastest, in which 1/x is nearly a straight line; and those that turn
once beyond one of the ends, by the speed of sound where they turn.  Speeds are held as differences from that of the upper end.
"""

from __future__ import annotations

import math

import numpy as np

from leadline.core.compiled import kernel
from leadline.core.water import pressure_of_depth, sound_speed

CELLS = 8  # of the search for rays that turn within one layer
NEAR = 1e-3  # m: ends as near as this are joined by a straight line
LEAST = 1e-12  # smallest share of a layer's speeds, as a square root, in which a turn is searched


@kernel()
def layer_of(depth, at):
    """Index of the layer that a depth lies in, the lower one at a boundary."""
    low, high = 0, len(depth) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if depth[middle] <= at:
            low = middle
        else:
            high = middle
    return low


@kernel()
def arc(h, g, c1, c2, s1, s2, p):
    """Time (s) and length (m) of a ray through one layer."""
    both = c1 + c2
    w = h * both * (1.0 + s1 * s2) / ((s1 + s2) * (c1 * c1 + c2 * c2 - (p * c1 * c2) ** 2))
    y = g * w
    if abs(y) < 1e-3:
        time = w * (1.0 + y * y * (1.0 / 3.0 + y * y * (0.2 + y * y / 7.0)))
    else:
        time = math.atanh(y) / g
    u = h * both / (s1 * c2 + c1 * s2)
    sine = abs(p * g * u)
    bend = math.atan2(sine, p * p * c1 * c2 + s1 * s2)
    return time, u * (bend / sine if sine > 1e-8 else 1.0 + sine * sine / 6.0)


@kernel()
def inner(depth, speed, upper, lower, e, h, g):
    """Fill the layers between two depths: speeds against that of the upper end, thicknesses, gradients; return how many."""
    i, k = layer_of(depth, upper), layer_of(depth, lower)
    n, top = 0, upper
    e[0] = 0.0
    for j in range(i, k + 1):
        bottom = lower if j == k else depth[j + 1]
        if bottom > top:
            h[n] = bottom - top
            g[n] = (speed[j + 1] - speed[j]) / (depth[j + 1] - depth[j])
            whole = top == depth[j] and bottom == depth[j + 1]
            e[n + 1] = e[n] + (speed[j + 1] - speed[j] if whole else g[n] * h[n])
            n += 1
        top = bottom
    return n


@kernel()
def outer(depth, speed, start, down, e0, e, h, g):
    """Fill the layers beyond a depth, outward, as `inner` does: gradients count outward; return how many."""
    n, near, last = 0, start, len(depth) - 1
    e[0] = e0
    j = layer_of(depth, start)
    while 0 <= j < last:
        far = depth[j + 1] if down else depth[j]
        whole = near == (depth[j] if down else depth[j + 1])
        rise = speed[j + 1] - speed[j] if down else speed[j] - speed[j + 1]
        if far != near:
            h[n] = abs(far - near)
            g[n] = rise / (depth[j + 1] - depth[j])
            e[n + 1] = e[n] + (rise if whole else g[n] * h[n])
            n += 1
        near = far
        j += 1 if down else -1
    return n


@kernel()
def reach(q, w, a, n):
    """Horizontal distance of a ray that does not turn, and its slope in q = cot(elevation) where sound is fastest."""
    total, slope = 0.0, 0.0
    r1 = math.sqrt(1.0 + q * q * w[0])
    d1 = w[0] / r1
    for j in range(n):
        r2 = math.sqrt(1.0 + q * q * w[j + 1])
        d2 = w[j + 1] / r2
        share = a[j] / (r1 + r2)
        total += share
        slope += share * (1.0 - q * q * (d1 + d2) / (r1 + r2))
        r1, d1 = r2, d2
    return q * total, slope


@kernel()
def without_turn(x, c0, e, h, g, n, w, a, ray):
    """Write time, length and both elevations (positive down) of the ray that does not turn; say whether there is one."""
    top = 0.0
    for j in range(1, n + 1):
        top = max(top, e[j])
    c, farthest, start = c0 + top, 0.0, 0.0
    for j in range(n + 1):
        w[j] = (top - e[j]) * (c + c0 + e[j]) / (c * c)
    for j in range(n):
        a[j] = (2.0 * c0 + e[j] + e[j + 1]) * h[j] / c
        start += 0.5 * a[j]
        farthest += a[j] / (math.sqrt(w[j]) + math.sqrt(w[j + 1]))
    if x > farthest * (1.0 + 1e-12):
        return False
    q, found = 0.0, 0.0
    if x > 0.0:
        low, high = 0.0, start / x
        y = max(start * (1.0 / x - 1.0 / farthest), 1e-14 * high)
        for _ in range(100):
            q = 1.0 / y
            found, slope = reach(q, w, a, n)
            if abs(found - x) <= 4e-16 * x:
                break
            if found > x:
                low = y
            else:
                high = y
            previous = y
            y -= (1.0 / found - 1.0 / x) * found * found / (q * q * slope)
            if not low < y < high:
                y = 0.5 * (low + high)
            if abs(y - previous) <= 2e-16 * y:
                break
        q = 1.0 / y
        found, slope = reach(q, w, a, n)
    root = math.sqrt(1.0 + q * q)
    p = q / (c * root)
    time, length = 0.0, 0.0
    s1 = math.sqrt(1.0 + q * q * w[0]) / root
    ray[2] = math.atan2(s1, p * c0)
    for j in range(n):
        s2 = math.sqrt(1.0 + q * q * w[j + 1]) / root
        t, l = arc(h[j], g[j], c0 + e[j], c0 + e[j + 1], s1, s2, p)
        time += t
        length += l
        s1 = s2
    ray[0], ray[1] = time + p * (x - found), length
    ray[3] = math.atan2(s1, p * (c0 + e[n]))
    return True


@kernel()
def path_to(delta, top, c0, e, h, n):
    """Horizontal distance through layers of a ray that turns where the speed is top + delta, and its slope in that speed."""
    c = c0 + top + delta
    total, slope = 0.0, 0.0
    r1 = math.sqrt((top - e[0] + delta) * (c + c0 + e[0]))
    for j in range(n):
        r2 = math.sqrt((top - e[j + 1] + delta) * (c + c0 + e[j + 1]))
        share = (2.0 * c0 + e[j] + e[j + 1]) * h[j] / (r1 + r2)
        total += share
        slope -= share * c / (r1 * r2)
        r1 = r2
    return total, slope, r1


@kernel()
def turned_reach(v, span, top, c0, e, h, n, eo, ho, m, g):
    """Horizontal distance of a ray that turns beyond m outer layers, in one of gradient g, and its slope in v."""
    delta = span * v * v
    x, slope, _ = path_to(delta, top, c0, e, h, n)
    beyond, steep, r = path_to(delta, top, c0, eo, ho, m)
    steep += (c0 + top + delta) / (r * g)
    return x + 2.0 * (beyond + r / g), (slope + 2.0 * steep) * 2.0 * span * v


@kernel()
def turn_between(low, high, f_low, x, span, top, c0, e, h, n, eo, ho, m, g):
    """Root v of the distance x between two v at which it is missed on different sides."""
    v = 0.5 * (low + high)
    for _ in range(100):
        found, slope = turned_reach(v, span, top, c0, e, h, n, eo, ho, m, g)
        f, previous = found - x, v
        if abs(f) <= 4e-16 * x:
            break
        if (f > 0.0) == (f_low > 0.0):
            low = v
        else:
            high = v
        v -= f / slope
        if not low < v < high:
            v = 0.5 * (low + high)
        if abs(v - previous) <= 2e-16 * v:
            break
    return v


@kernel()
def nearest_miss(low, high, d_low, x, f_low, span, top, c0, e, h, n, eo, ho, m, g):
    """A v between two on the same side of x where the distance is on the other side, or is extreme; and by how much it is missed."""
    v, f = low, f_low
    for _ in range(60):
        v = 0.5 * (low + high)
        found, slope = turned_reach(v, span, top, c0, e, h, n, eo, ho, m, g)
        f = found - x
        if (f > 0.0) != (f_low > 0.0):
            break
        if (slope > 0.0) == (d_low > 0.0):
            low = v
        else:
            high = v
    return v, f


@kernel()
def keep_turn(v, x, span, top, c0, e, h, n, eo, ho, go, m, sign, ray):
    """Write the ray that turns at v over a slower one; sign is +1 where it turns below both ends, -1 above."""
    delta = span * v * v
    c = c0 + top + delta
    p, time, length = 1.0 / c, 0.0, 0.0
    s1 = math.sqrt((top - e[0] + delta) * (c + c0 + e[0])) / c
    first = math.atan2(s1, p * c0)
    for j in range(n):
        s2 = math.sqrt((top - e[j + 1] + delta) * (c + c0 + e[j + 1])) / c
        t, l = arc(h[j], (e[j + 1] - e[j]) / h[j], c0 + e[j], c0 + e[j + 1], s1, s2, p)
        time += t
        length += l
        s1 = s2
    last = math.atan2(s1, p * (c0 + e[n]))
    s1 = math.sqrt((top - eo[0] + delta) * (c + c0 + eo[0])) / c
    for j in range(m):
        s2 = math.sqrt((top - eo[j + 1] + delta) * (c + c0 + eo[j + 1])) / c
        t, l = arc(ho[j], go[j], c0 + eo[j], c0 + eo[j + 1], s1, s2, p)
        time += 2.0 * t
        length += 2.0 * l
        s1 = s2
    time += 2.0 * math.atanh(s1) / go[m]
    length += 2.0 * c * math.atan2(s1, p * (c0 + eo[m])) / go[m]
    found, _ = turned_reach(v, span, top, c0, e, h, n, eo, ho, m, go[m])
    time += p * (x - found)
    if not time >= ray[0]:
        ray[0], ray[1], ray[2], ray[3] = time, length, sign * first, -sign * last


@kernel()
def with_turn(x, dz, c0, e, h, n, eo, ho, go, layers, sign, ray):
    """Write the fastest ray that turns once in one of the outer layers, where it is faster than what stands there."""
    top, least = 0.0, 0.0
    for j in range(1, n + 1):
        top, least = max(top, e[j]), min(least, e[j])
    most = top
    for j in range(layers):
        most, least = max(most, eo[j + 1]), min(least, eo[j + 1])
    steepest = math.sqrt((most - least) * (2.0 * c0 + most + least)) / (c0 + least)
    away = dz  # how far up and down the ray has to go at least
    for m in range(layers):
        if away > x * steepest * (1.0 + 1e-9):
            return
        top = max(top, eo[m])
        span = eo[m + 1] - top
        if span > 0.0 and not math.sqrt(x * x + away * away) / (c0 + eo[m + 1]) >= ray[0]:
            g, smallest = go[m], span * LEAST * LEAST
            a1, _, _ = path_to(span, top, c0, e, h, n)
            b1, _, r1 = path_to(span, top, c0, eo, ho, m)
            a0, _, _ = path_to(smallest, top, c0, e, h, n)
            b0, _, _ = path_to(smallest, top, c0, eo, ho, m)
            if a1 + 2.0 * b1 <= x * (1.0 + 1e-12) and a0 + 2.0 * (b0 + r1 / g) >= x * (1.0 - 1e-12):
                low = LEAST
                found, d_low = turned_reach(low, span, top, c0, e, h, n, eo, ho, m, g)
                f_low = found - x
                for cell in range(1, CELLS + 1):
                    high = (cell / CELLS) ** 2
                    found, d_high = turned_reach(high, span, top, c0, e, h, n, eo, ho, m, g)
                    f_high = found - x
                    if f_low == 0.0 or (f_low > 0.0) != (f_high > 0.0):
                        v = low if f_low == 0.0 else turn_between(low, high, f_low, x, span, top, c0, e, h, n, eo, ho, m, g)
                        keep_turn(v, x, span, top, c0, e, h, n, eo, ho, go, m, sign, ray)
                    elif (d_low > 0.0) != (d_high > 0.0) and (f_low > 0.0) == (d_low < 0.0):
                        v, f = nearest_miss(low, high, d_low, x, f_low, span, top, c0, e, h, n, eo, ho, m, g)
                        if (f > 0.0) != (f_low > 0.0):
                            for side in range(2):
                                end, f_end = (low, f_low) if side == 0 else (v, f)
                                other = v if side == 0 else high
                                root = turn_between(end, other, f_end, x, span, top, c0, e, h, n, eo, ho, m, g)
                                keep_turn(root, x, span, top, c0, e, h, n, eo, ho, go, m, sign, ray)
                    low, f_low, d_low = high, f_high, d_high
        away += 2.0 * ho[m]


@kernel()
def level_water(depth, speed, at):
    """Say whether the speed of sound does not change with depth, on one side at least."""
    k = layer_of(depth, at)
    return speed[k + 1] == speed[k] or (at == depth[k] and k > 0 and speed[k] == speed[k - 1])


@kernel()
def speed_of(depth, speed, at):
    """Speed of sound at a depth."""
    k = layer_of(depth, at)
    return speed[k] + (speed[k + 1] - speed[k]) / (depth[k + 1] - depth[k]) * (at - depth[k])


@kernel()
def trace(depth, speed, horizontal, depth_a, depth_b, rays):
    """Write time, length, elevation at a and at b of the fastest direct ray into each row of `rays`; nan where there is none."""
    size = len(depth) + 1
    e, h, g, w, a = np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    eo, ho, go = np.empty(size), np.empty(size), np.empty(size)
    for row in range(len(horizontal)):
        x, ray = horizontal[row], rays[row]
        upper, lower = min(depth_a[row], depth_b[row]), max(depth_a[row], depth_b[row])
        dz = lower - upper
        ray[:] = math.nan
        if not (x >= 0.0 and math.isfinite(x) and math.isfinite(dz)):
            continue
        c0 = speed_of(depth, speed, upper)
        chord = math.sqrt(x * x + dz * dz)
        if chord < NEAR or (dz == 0.0 and level_water(depth, speed, upper)):
            ray[0], ray[1] = chord / c0, chord
            ray[2] = ray[3] = math.atan2(dz, x)
        n = inner(depth, speed, upper, lower, e, h, g)
        if chord >= NEAR:
            if dz > 0.0:
                without_turn(x, c0, e, h, g, n, w, a, ray)
            layers = outer(depth, speed, lower, True, e[n], eo, ho, go)
            with_turn(x, dz, c0, e, h, n, eo, ho, go, layers, 1.0, ray)
            layers = outer(depth, speed, upper, False, 0.0, eo, ho, go)
            with_turn(x, dz, c0, e, h, n, eo, ho, go, layers, -1.0, ray)
        if depth_a[row] > depth_b[row]:
            ray[2], ray[3] = -ray[3], -ray[2]


@kernel()
def speeds(depth, temperature, salinity, gravity, result):
    """Write the speed of sound (m/s) at each depth (m), from degrees Celsius, practical salinity and gravity at the surface."""
    for k in range(len(depth)):
        pressure, _ = pressure_of_depth(depth[k], gravity)
        result[k] = sound_speed(temperature[k], salinity[k], pressure)
