"""Signed distance and gradient of one point to one shape, compiled; every shape exact.

All kernels take the point in the shape's own frame (Drake's: axes along z, origin in the middle)
and return the distance (m, negative inside) and its gradient (unit vector, in that frame). Where
several points of the surface are nearest, the gradient is that of one of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from pips_drake.scene.triangles import nearest_on_triangle

SPHERE, HALF_SPACE, BOX, CYLINDER, CAPSULE, ELLIPSOID, CONVEX = range(7)

# Newton's steps from below are monotonic and each at least halves the distance in the logarithm;
# the longest run seen is 60.
_MOST_NEWTON_STEPS = 200


class FieldArrays(NamedTuple):
    """Shapes in the world as arrays, for compiled code; M shapes.

    Attributes:
        kinds: (M,), SPHERE to CONVEX.
        sizes: (M, 3) m. Sphere: radius; box: half lengths; cylinder, capsule: radius, half length;
            ellipsoid: half axes.
        rotations, positions: poses of the shapes in the world, (M, 3, 3), (M, 3) m.
        extents: half lengths of a box around each shape in its own frame, centred there, (M, 3) m;
            infinite for half spaces and convex meshes.
        centres, radii: a ball in the world around each shape, (M, 3) m, (M,) m; a half space's is
            infinite.
        planes: of convex meshes' faces, (P, 4): inside, n . x + d <= 0; in the shape's frame.
        triangles: of convex meshes, (P, 3, 3) m, row for row those of `planes`.
        starts: where the faces of each shape begin, (M + 1,).
    """

    kinds: NDArray[np.int64]
    sizes: NDArray[np.float64]
    rotations: NDArray[np.float64]
    positions: NDArray[np.float64]
    extents: NDArray[np.float64]
    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    planes: NDArray[np.float64]
    triangles: NDArray[np.float64]
    starts: NDArray[np.int64]


@numba.njit(cache=True)
def _round_distance(x, y, z, radius):
    length = math.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        return -radius, 1.0, 0.0, 0.0
    return length - radius, x / length, y / length, z / length


@numba.njit(cache=True)
def _box_distance(x, y, z, half_x, half_y, half_z):
    qx, qy, qz = abs(x) - half_x, abs(y) - half_y, abs(z) - half_z
    sx, sy, sz = math.copysign(1.0, x), math.copysign(1.0, y), math.copysign(1.0, z)
    if qx <= 0.0 and qy <= 0.0 and qz <= 0.0:
        if qx >= qy and qx >= qz:
            return qx, sx, 0.0, 0.0
        if qy >= qz:
            return qy, 0.0, sy, 0.0
        return qz, 0.0, 0.0, sz
    qx, qy, qz = max(qx, 0.0), max(qy, 0.0), max(qz, 0.0)
    distance = math.sqrt(qx * qx + qy * qy + qz * qz)
    return distance, sx * qx / distance, sy * qy / distance, sz * qz / distance


@numba.njit(cache=True)
def _cylinder_distance(x, y, z, radius, half):
    """A box in the plane of radius and height."""
    around = math.sqrt(x * x + y * y)
    ux, uy = (x / around, y / around) if around > 0.0 else (1.0, 0.0)
    out, over, sign = around - radius, abs(z) - half, math.copysign(1.0, z)
    if out <= 0.0 and over <= 0.0:
        if out >= over:
            return out, ux, uy, 0.0
        return over, 0.0, 0.0, sign
    out, over = max(out, 0.0), max(over, 0.0)
    distance = math.sqrt(out * out + over * over)
    return distance, ux * out / distance, uy * out / distance, sign * over / distance


@numba.njit(cache=True)
def _capsule_distance(x, y, z, radius, half):
    return _round_distance(x, y, z - min(max(z, -half), half), radius)


@numba.njit(cache=True)
def _ellipsoid_distance(x, y, z, a, b, c):
    """Nearest point by the root of its multiplier (Eberly, Distance from a Point to an Ellipsoid).

    With e the least half axis, r = (a, b, c)^2 / e^2 and w = |p| / (a, b, c), the nearest point is
    r p / (u + r - 1) for the u > 0 where sum (r w / (u + r - 1))^2 = 1. The sum falls and is
    convex, so that Newton's steps from the left never pass the root. Counting u from the least
    axis' pole keeps all digits of points near the middle.
    """
    least = min(a, b, c)
    ra, rb, rc = (a / least) ** 2, (b / least) ** 2, (c / least) ** 2
    # Ahead of the sums with u, which may be as little as 1e-14.
    la, lb, lc = ra - 1.0, rb - 1.0, rc - 1.0
    # A point in a plane of symmetry has two nearest points on either side of it: take one.
    tiny = 1e-14
    wx, wy, wz = max(abs(x) / a, tiny), max(abs(y) / b, tiny), max(abs(z) / c, tiny)
    # Each term alone is at least 1 to the left of these.
    u = max(ra * wx - la, rb * wy - lb, rc * wz - lc)
    for _ in range(_MOST_NEWTON_STEPS):
        va, vb, vc = u + la, u + lb, u + lc
        ta, tb, tc = ra * wx / va, rb * wy / vb, rc * wz / vc
        value = ta * ta + tb * tb + tc * tc - 1.0
        slope = -2.0 * (ta * ta / va + tb * tb / vb + tc * tc / vc)
        step = -value / slope
        if not step > 1e-16 * u:
            break
        u += step
    va, vb, vc = u + la, u + lb, u + lc
    # In units of the half axes, and put back onto the surface.
    fx, fy, fz = ra * wx / va, rb * wy / vb, rc * wz / vc
    onto = 1.0 / math.sqrt(fx * fx + fy * fy + fz * fz)
    fx, fy, fz = fx * onto, fy * onto, fz * onto
    dx, dy, dz = abs(x) - a * fx, abs(y) - b * fy, abs(z) - c * fz
    inside = (x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2 < 1.0
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    nx, ny, nz = fx / a, fy / b, fz / c
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    return (
        -distance if inside else distance,
        math.copysign(nx / length, x),
        math.copysign(ny / length, y),
        math.copysign(nz / length, z),
    )


@numba.njit(cache=True)
def _convex_distance(x, y, z, planes, triangles, first, last):
    """Inside, the nearest face's plane; outside, the nearest of all triangles."""
    highest, face = -np.inf, first
    for k in range(first, last):
        height = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z + planes[k, 3]
        if height > highest:
            highest, face = height, k
    if highest <= 0.0:
        return highest, planes[face, 0], planes[face, 1], planes[face, 2]
    best = np.inf
    nx = ny = nz = 0.0
    for k in range(first, last):
        # The nearest point lies on a face that the point is in front of.
        if planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z + planes[k, 3] < 0.0:
            continue
        sx, sy, sz = nearest_on_triangle(x, y, z, triangles[k])
        square = (x - sx) ** 2 + (y - sy) ** 2 + (z - sz) ** 2
        if square < best:
            best, nx, ny, nz = square, sx, sy, sz
    distance = math.sqrt(best)
    if distance < 1e-9 * (abs(x) + abs(y) + abs(z)):  # direction lost in rounding
        return distance, planes[face, 0], planes[face, 1], planes[face, 2]
    return distance, (x - nx) / distance, (y - ny) / distance, (z - nz) / distance


@numba.njit(cache=True)
def _in_shape(field, m, x, y, z):
    """A point of the world in the frame of shape m."""
    R, p = field.rotations[m], field.positions[m]
    dx, dy, dz = x - p[0], y - p[1], z - p[2]
    return (
        R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz,
        R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz,
        R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz,
    )


@numba.njit(cache=True)
def _rotated(R, x, y, z):
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@numba.njit(cache=True)
def _distance_in_shape(field, m, x, y, z):
    """Signed distance and gradient of a point to shape m, all in the shape's frame."""
    size, kind = field.sizes[m], field.kinds[m]
    if kind == BOX:
        return _box_distance(x, y, z, size[0], size[1], size[2])
    if kind == CYLINDER:
        return _cylinder_distance(x, y, z, size[0], size[1])
    if kind == SPHERE:
        return _round_distance(x, y, z, size[0])
    if kind == CAPSULE:
        return _capsule_distance(x, y, z, size[0], size[1])
    if kind == HALF_SPACE:
        return z, 0.0, 0.0, 1.0
    if kind == ELLIPSOID:
        return _ellipsoid_distance(x, y, z, size[0], size[1], size[2])
    return _convex_distance(
        x, y, z, field.planes, field.triangles, field.starts[m], field.starts[m + 1]
    )


@numba.njit(cache=True)
def distance_to_shape(field, m, x, y, z):
    """Signed distance of a point in the world to shape m, and its gradient in the world."""
    lx, ly, lz = _in_shape(field, m, x, y, z)
    d, gx, gy, gz = _distance_in_shape(field, m, lx, ly, lz)
    gx, gy, gz = _rotated(field.rotations[m], gx, gy, gz)
    return d, gx, gy, gz


@numba.njit(cache=True)
def least_distance(field, x, y, z, chosen, count):
    """The least signed distance of a point to the first `count` of the `chosen` shapes.

    Returns:
        Distance (m), infinite without shapes; its gradient (zeros then); the shape (-1 then).
    """
    best, shape = np.inf, -1
    gx = gy = gz = 0.0
    for i in range(count):
        m = chosen[i]
        # No point of the shape's ball is nearer than this.
        reach = best + field.radii[m]
        cx, cy, cz = field.centres[m, 0] - x, field.centres[m, 1] - y, field.centres[m, 2] - z
        if reach < 0.0 or cx * cx + cy * cy + cz * cz > reach * reach:
            continue
        lx, ly, lz = _in_shape(field, m, x, y, z)
        extent = field.extents[m]
        if abs(lx) - extent[0] > best or abs(ly) - extent[1] > best or abs(lz) - extent[2] > best:
            continue
        d, hx, hy, hz = _distance_in_shape(field, m, lx, ly, lz)
        if d < best:
            best, shape, gx, gy, gz = d, m, hx, hy, hz
    if shape >= 0:
        gx, gy, gz = _rotated(field.rotations[shape], gx, gy, gz)
    return best, gx, gy, gz, shape


@numba.njit(cache=True)
def distances_many(field, points):
    """Distances (N,), gradients (N, 3) and shapes (N,) of points (N, 3) in the world."""
    count, shapes = points.shape[0], field.kinds.shape[0]
    every = np.arange(shapes)
    distance, gradient = np.empty(count), np.empty((count, 3))
    nearest = np.empty(count, dtype=np.int64)
    for i in range(count):
        d, gx, gy, gz, m = least_distance(
            field, points[i, 0], points[i, 1], points[i, 2], every, shapes
        )
        distance[i], nearest[i] = d, m
        gradient[i, 0], gradient[i, 1], gradient[i, 2] = gx, gy, gz
    return distance, gradient, nearest


@numba.njit(cache=True)
def distances_to_groups(field, groups, count, points):
    """Distances (N, B) and gradients (N, B, 3) of points (N, 3) to B = `count` groups of shapes.

    Args:
        groups: the group of each shape, (M,), from 0; every group has a shape.
    """
    distance = np.full((points.shape[0], count), np.inf)
    gradient = np.zeros((points.shape[0], count, 3))
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for m in range(groups.shape[0]):
            b = groups[m]
            d, gx, gy, gz = distance_to_shape(field, m, x, y, z)
            if d < distance[i, b]:
                distance[i, b] = d
                gradient[i, b, 0], gradient[i, b, 1], gradient[i, b, 2] = gx, gy, gz
    return distance, gradient


@numba.njit(cache=True)
def blended_to_groups(field, groups, count, points, blend, within):
    """As `distances_to_groups`, without the leaps of the gradient where two shapes are as near.

    Of a group's distances d_m: -blend ln(sum exp(-d_m / blend)), and its own gradient.

    Args:
        blend: m, > 0.
        within: m; shapes whose ball or box is farther from a point are left out.
    """
    distance = np.full((points.shape[0], count), np.inf)
    gradient = np.zeros((points.shape[0], count, 3))
    total = np.empty(count)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        total[:] = 0.0
        for m in range(groups.shape[0]):
            reach = within + field.radii[m]
            cx, cy, cz = field.centres[m, 0] - x, field.centres[m, 1] - y, field.centres[m, 2] - z
            if cx * cx + cy * cy + cz * cz > reach * reach:
                continue
            lx, ly, lz = _in_shape(field, m, x, y, z)
            extent = field.extents[m]
            # Long things have wide balls: a stave of a bay holds the whole bay.
            if (
                abs(lx) - extent[0] > within
                or abs(ly) - extent[1] > within
                or abs(lz) - extent[2] > within
            ):
                continue
            b = groups[m]
            d, gx, gy, gz = _distance_in_shape(field, m, lx, ly, lz)
            gx, gy, gz = _rotated(field.rotations[m], gx, gy, gz)
            least = distance[i, b]
            # Weights are kept relative to the least distance so far.
            if d < least:
                shrink = math.exp((d - least) / blend)  # 0 for the first
                distance[i, b], share = d, 1.0
            else:
                shrink, share = 1.0, math.exp((least - d) / blend)
            total[b] = shrink * total[b] + share
            gradient[i, b, 0] = shrink * gradient[i, b, 0] + share * gx
            gradient[i, b, 1] = shrink * gradient[i, b, 1] + share * gy
            gradient[i, b, 2] = shrink * gradient[i, b, 2] + share * gz
        for b in range(count):
            if total[b] > 0.0:
                distance[i, b] -= blend * math.log(total[b])
                for k in range(3):
                    gradient[i, b, k] /= total[b]
    return distance, gradient
