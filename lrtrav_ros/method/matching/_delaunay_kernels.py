"""Compiled parts of the triangulation. The arguments are checked, and the method explained, in `delaunay`.

A triangle is three corners, counter-clockwise where v points up. Its edge k leads from corner k to the next one; edges
of all triangles are numbered through, three to a triangle, and `twins` has the same edge of the neighbour, -1 for none.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import inlined_kernel, kernel

Points: TypeAlias = NDArray[np.float64]  # (n, 2)
Indices: TypeAlias = NDArray[np.int32]


class _Mesh(NamedTuple):
    """The triangles so far, and their convex hull: for each of its points its neighbours and the edge to the next."""

    points: Points
    corners: Indices
    twins: Indices
    before: Indices
    after: Indices
    hull_edges: Indices
    pending: Indices  # edges yet to be checked


@inlined_kernel
def _turn(points: Points, a: int, b: int, c: int) -> float:
    """Return twice the area of a triangle, positive if it is counter-clockwise."""
    ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    vx, vy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
    return ux * vy - uy * vx


@inlined_kernel
def _encircles(points: Points, a: int, b: int, c: int, p: int) -> bool:
    """Return whether the circle through a counter-clockwise triangle has another point inside."""
    ax, ay = points[a, 0] - points[p, 0], points[a, 1] - points[p, 1]
    bx, by = points[b, 0] - points[p, 0], points[b, 1] - points[p, 1]
    cx, cy = points[c, 0] - points[p, 0], points[c, 1] - points[p, 1]
    a2, b2, c2 = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    return ax * (by * c2 - b2 * cy) - ay * (bx * c2 - b2 * cx) + a2 * (bx * cy - by * cx) > 0


@kernel
def centre_of(points: Points, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Return the centre (u, v) of the circle through three points, and its squared radius; infinite if on one line."""
    ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    vx, vy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
    area = ux * vy - uy * vx
    if area == 0:
        return np.inf, np.inf, np.inf
    u2, v2 = ux * ux + uy * uy, vx * vx + vy * vy
    x, y = (vy * u2 - uy * v2) / (2 * area), (ux * v2 - vx * u2) / (2 * area)
    return points[a, 0] + x, points[a, 1] + y, x * x + y * y


@kernel
def _nearest(points: Points, u: float, v: float) -> int:
    """Return the point nearest to a place, but not there; -1 for none."""
    nearest, least = -1, np.inf
    for n in range(len(points)):
        distance = (points[n, 0] - u) ** 2 + (points[n, 1] - v) ** 2
        if 0 < distance < least:
            nearest, least = n, distance
    return nearest


@kernel
def first_triangle(points: Points) -> tuple[int, int, int]:
    """Return a point near the middle, the one next to it, and that of the smallest circle with both; -1 for none."""
    u, v = points[:, 0], points[:, 1]
    first = max(_nearest(points, (u.min() + u.max()) / 2, (v.min() + v.max()) / 2), 0)
    second = _nearest(points, points[first, 0], points[first, 1])
    third, least = -1, np.inf
    for n in range(len(points) if second >= 0 else 0):
        if n not in (first, second):
            radius2 = centre_of(points, first, second, n)[2]
            if radius2 < least:
                third, least = n, radius2
    if third >= 0 and _turn(points, first, second, third) < 0:
        second, third = third, second
    return first, second, third


@inlined_kernel
def _link(twins: Indices, edge: int, other: int) -> None:
    """Make two edges, the second of which may be none, one."""
    twins[edge] = other
    if other >= 0:
        twins[other] = edge


@inlined_kernel
def _add_triangle(mesh: _Mesh, n: int, a: int, b: int, c: int, beyond_a: int, beyond_b: int, beyond_c: int) -> None:
    """Set triangle n to three points, and the edges that begin there to those of the neighbours."""
    corners = mesh.corners[3 * n : 3 * n + 3]
    corners[0], corners[1], corners[2] = a, b, c
    _link(mesh.twins, 3 * n, beyond_a)
    _link(mesh.twins, 3 * n + 1, beyond_b)
    _link(mesh.twins, 3 * n + 2, beyond_c)


@inlined_kernel
def _turned(edge: int, by: int) -> int:
    """Return the next edge (by 1), or the one before (by 2), of the same triangle."""
    return edge - edge % 3 + (edge + by) % 3


@kernel
def _rename_hull_edge(mesh: _Mesh, old: int, new: int, start: int) -> None:
    """Replace an edge of the hull, looking backwards from a point."""
    point = start
    while True:
        if mesh.hull_edges[point] == old:
            mesh.hull_edges[point] = new
            return
        point = mesh.before[point]
        if point == start:
            return


@kernel
def _flip(mesh: _Mesh, edge: int, twin: int, start: int) -> int:
    """Give a quadrilateral of two triangles its other diagonal; return an edge whose neighbour is to be checked.

    The edge of the first triangle that comes after `edge` stays in place, to be checked as well.
    """
    last, twin_last = _turned(edge, 2), _turned(twin, 2)
    mesh.corners[edge], mesh.corners[twin] = mesh.corners[twin_last], mesh.corners[last]
    outer = mesh.twins[twin_last]
    if outer < 0:
        _rename_hull_edge(mesh, twin_last, edge, start)
    _link(mesh.twins, edge, outer)
    _link(mesh.twins, twin, mesh.twins[last])
    _link(mesh.twins, last, twin_last)
    return _turned(twin, 1)


@kernel
def _legalise(mesh: _Mesh, edge: int, start: int) -> int:
    """Flip edges, beginning with one, until no circle has a point inside; return the edge that came before it."""
    n_pending = 0
    while True:
        twin, last = mesh.twins[edge], _turned(edge, 2)
        if twin >= 0 and _encircles(
            mesh.points, mesh.corners[last], mesh.corners[edge], mesh.corners[_turned(edge, 1)],
            mesh.corners[_turned(twin, 2)],
        ):  # fmt: skip
            other = _flip(mesh, edge, twin, start)
            if n_pending < mesh.pending.size:
                mesh.pending[n_pending] = other
                n_pending += 1
        elif n_pending:
            n_pending -= 1
            edge = mesh.pending[n_pending]
        else:
            return last


@inlined_kernel
def _direction(u: float, v: float, n: int) -> int:
    """Return the number, 0 .. n - 1, of the sector in which a direction lies; it grows with the angle."""
    p = u / (abs(u) + abs(v) + 1e-300)
    return min(int(n * ((3 - p if v > 0 else 1 + p) / 4)), n - 1)


@kernel
def _visible_edge(mesh: _Mesh, point: int, start: int) -> int:
    """Return the first point of the first edge of the hull, from a point on, that another point sees; -1 for none."""
    edge = start
    while _turn(mesh.points, point, edge, mesh.after[edge]) >= 0:
        edge = mesh.after[edge]
        if edge == start:
            return -1
    return edge


@kernel
def _add_point(mesh: _Mesh, point: int, start: int, count: int) -> tuple[int, int]:
    """Join a point outside of the hull to all that it sees; return the point before it, and the number of triangles."""
    before, after, hull_edges = mesh.before, mesh.after, mesh.hull_edges
    first = _visible_edge(mesh, point, start)
    if first < 0:  # on another point
        return -1, count
    last = after[first]
    _add_triangle(mesh, count, first, point, last, -1, -1, hull_edges[first])
    hull_edges[point] = _legalise(mesh, 3 * count + 2, first)
    hull_edges[first] = 3 * count
    count += 1
    while _turn(mesh.points, point, last, after[last]) < 0:
        following = after[last]
        _add_triangle(mesh, count, last, point, following, hull_edges[point], -1, hull_edges[last])
        hull_edges[point] = _legalise(mesh, 3 * count + 2, first)
        after[last] = last  # no longer on the hull
        count += 1
        last = following
    while first == start and _turn(mesh.points, point, before[first], first) < 0:
        start = before[first]
        _add_triangle(mesh, count, start, point, first, -1, hull_edges[first], hull_edges[start])
        _legalise(mesh, 3 * count + 2, first)
        hull_edges[start] = 3 * count
        after[first] = first
        count += 1
        first = start
    before[point], after[point] = first, last
    after[first], before[last] = point, point
    return first, count


@kernel
def triangulate(
    points: Points, seed: tuple[int, int, int], order: NDArray[np.int64], u: float, v: float, corners: Indices
) -> int:
    """Set `corners` to those of the triangles, and return three times the number of these.

    Begins with the triangle `seed`, counter-clockwise, and adds the other points in the order of their distance from
    its centre (u, v), so that each lies outside of the hull of those before.
    """
    n = len(points)
    hull = np.empty((3, n), np.int32)
    mesh = _Mesh(points, corners, np.empty(corners.size, np.int32), hull[0], hull[1], hull[2], np.empty(512, np.int32))
    n_sectors = int(np.ceil(np.sqrt(n)))
    sectors = np.full(n_sectors, -1, np.int32)  # some point of the hull for each direction
    _add_triangle(mesh, 0, seed[0], seed[1], seed[2], -1, -1, -1)
    for k in range(3):
        point = seed[k]
        mesh.before[point], mesh.after[point], mesh.hull_edges[point] = seed[k - 1], seed[(k + 1) % 3], k
        sectors[_direction(points[point, 0] - u, points[point, 1] - v, n_sectors)] = point
    count = 1
    for point in order:
        if point in seed:
            continue
        sector = _direction(points[point, 0] - u, points[point, 1] - v, n_sectors)
        start = -1
        for k in range(n_sectors):
            start = sectors[(sector + k) % n_sectors]
            if start >= 0 and mesh.after[start] != start:
                break
        first, count = _add_point(mesh, point, mesh.before[start], count)
        if first >= 0:
            sectors[sector] = point
            sectors[_direction(points[first, 0] - u, points[first, 1] - v, n_sectors)] = first
    return 3 * count
