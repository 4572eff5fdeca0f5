"""Proposals that begin with the contacts: surface points first, then the hand that touches them.

A set of contacts is drawn that can hold the part (`contact_sets`); a posture whose places of
contact have the same distances is looked up (`grips`), and the palm is put where both agree. For a
pair the roll about its line is free: of many rolls and postures those are taken that bring all of
the hand's places to the surface, normals opposed, with the palm outside of the part and, where
constraints know a direction to come from, from there. The hand then closes and is judged like any
other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.evaluator import Attempts
from gpis_grasp_planner.search.contacts.contact_sets import ContactSampler, ContactSets
from gpis_grasp_planner.search.contacts.grips import (
    Pinches,
    Triads,
    pinches,
    triads,
    triangle_sides,
)
from gpis_grasp_planner.search.hand_fitting import HandFitting

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_WIDTH_M = 0.006  # how far a pinch's width may be from that of its contacts
_ROLLS = 16  # postures and rolls looked at for a pair
_NEIGHBOURS = 3  # triads looked at for each of a triple's orders
_GAP_M = 0.01  # a place this far from the surface costs as much as a normal at a right angle
_APPROACH = 1.0  # cost of coming from opposite to the direction that constraints know
_TEMPERATURE = 0.15
_FROM_ALLOWED = 0.75  # share of a pair's hands that come from where constraints let them
_ROLL_RAD = np.deg2rad(25.0)  # largest standard deviation of their rolls; half have under a quarter
_LEARN = 0.3  # cost that e times the worth makes up for
_DRAWN = 2  # sets drawn for each that is tried
_ROUNDS = 6  # of drawing, where constraints let few hands be
_BACK_M = 0.003
_FARTHEST_M = 0.015  # a hand farther from where constraints let it would miss its contacts
_PRIOR = 5.0  # attempts' worth of belief that a grip is like the others
_ORDERS = np.array([(0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)])


@dataclass(frozen=True, eq=False)
class _Hands:
    """Hands about sets of contacts: poses (n, 4, 4), rows of a table of grips, what they cost."""

    T_object_palm: Array
    preshape: Array
    joints: Array
    cell: Index
    owner: Index
    cost: Array

    def only(self, rows: Index | NDArray[np.bool_]) -> _Hands:
        return _Hands(*(getattr(self, f.name)[rows] for f in fields(self)))

    @classmethod
    def joined(cls, hands: Sequence[_Hands]) -> _Hands:
        return cls(*(np.concatenate([getattr(h, f.name) for h in hands]) for f in fields(cls)))


class ContactFirst:
    """Closes hands about sets of contacts.

    Which grips (sides and pre-shape) close well on this part is learnt on the way: they are drawn
    the more often.

    Parameters
    ----------
    context : PlanningContext
        Its archive takes every attempt.
    """

    def __init__(self, context: PlanningContext):
        self._context = context
        self._settings = context.settings.contacts
        self._fitting = HandFitting(context)
        self._max_deg = context.settings.adaption.spread_max_deg
        self._tried = np.zeros(0)
        self._worth = np.zeros(0)

    @property
    def able(self) -> bool:
        """Whether the part has sets of contacts that the hand spans; finds them at first."""
        pairs, triples = self._sets
        return len(pairs) + len(triples) > 0

    def attempt(self, n_sets: int) -> tuple[Attempts, Index]:
        """Close hands about sets of contacts, some seeds each; fewer where constraints let no more.

        Returns
        -------
        attempts : Attempts
            Of all hands that were free.
        owner : (B,) int array
            Which set each attempt is of.
        """
        hands = self._likeliest(n_sets)
        T, free = self._context.evaluator.clear_palm(
            hands.T_object_palm,
            -hands.T_object_palm[:, :3, 2],
            hands.preshape,
            np.zeros(len(hands.preshape)),
        )
        # An open hand that overlaps the part has to go back, and leaves its contacts.
        back = np.linalg.norm((T - hands.T_object_palm)[:, :3, 3], axis=1)
        kept = np.flatnonzero(free & (back < _BACK_M))[: n_sets * self._settings.n_seed]
        hands = hands.only(kept)
        attempts = self._fitting.attempt(T[kept], hands.preshape, hands.joints)
        self._context.archive.add(attempts)
        self._learn(hands.cell, attempts.objective_of_grasps(self._context.objective))
        return attempts, hands.owner

    def _likeliest(self, n_sets: int) -> _Hands:
        """Hands about sets of contacts, drawn until there are enough that constraints let be.

        Of a flat part on a table a few in a hundred are.
        """
        wanted = n_sets * self._settings.n_seed
        rounds: list[_Hands] = []
        for k in range(_ROUNDS if self._context.constraints else 1):
            hands = self._best_of(self._drawn(_DRAWN * n_sets))
            rounds.append(replace(hands, owner=hands.owner + k * _DRAWN * n_sets))
            if sum(len(hands.cost) for hands in rounds) >= wanted:
                break
        return _Hands.joined(rounds)

    def _drawn(self, n_sets: int) -> _Hands:
        """Many hands about each of some sets."""
        pairs, triples = self._sets
        rng = self._context.rng
        share = self._settings.triple_share if len(pairs) else 1.0
        n_triples = int(rng.binomial(n_sets, share)) if len(triples) else 0
        hands = []
        if n_triples:
            hands.append(self._about_triples(triples, triples.draw(n_triples, rng)))
        if n_triples < n_sets:
            drawn = pairs.draw(n_sets - n_triples, rng)
            about = self._about_pairs(pairs, drawn)
            hands.append(replace(about, owner=about.owner + n_triples))
        return _Hands.joined(hands)

    def _best_of(self, hands: _Hands) -> _Hands:
        """The likeliest hands of each set, likeliest first: low in cost, worthy in grip."""
        mean = (self._worth.sum() + 1e-6) / (self._tried.sum() + 1.0)
        worth = (self._worth + _PRIOR * mean) / (self._tried + _PRIOR)
        noise = self._context.rng.gumbel(size=len(hands.cost))
        merit = _TEMPERATURE * noise + _LEARN * np.log(worth[hands.cell] / mean) - hands.cost
        way = self._fitting.way_to_allowed(hands.T_object_palm, hands.joints)
        merit -= way / _GAP_M
        taken = np.zeros(int(hands.owner.max()) + 1, dtype=np.intp)
        chosen: list[int] = []
        for row in np.argsort(-merit, kind="stable"):
            owner = hands.owner[row]
            if way[row] < _FARTHEST_M and taken[owner] < self._settings.n_seed:
                taken[owner] += 1
                chosen.append(int(row))
        return hands.only(np.array(chosen, dtype=np.intp))

    def _learn(self, cell: Index, objective: Array) -> None:
        best = max(self._context.archive.best_epsilon, 1e-9)
        np.add.at(self._tried, cell, 1.0)
        np.add.at(self._worth, cell, np.sqrt(np.minimum(objective / best, 1.0)))

    @cached_property
    def _sets(self) -> tuple[ContactSets, ContactSets]:
        context = self._context
        sampler = ContactSampler(
            context.atlas,
            context.part.center_of_mass,
            context.max_radius,
            context.evaluator.friction.finger,
            context.rng,
        )
        widest = float(self._pinches.width[-1])
        pairs, triples = sampler.pairs(widest), sampler.triples(widest)
        n_cells = int(self._pinches.cell.max()) + 1
        if self._triads is None:
            triples = triples.none()
        else:
            self._first_triad = n_cells
            n_cells += int(self._triads.cell.max()) + 1
        self._tried, self._worth = np.zeros(n_cells), np.zeros(n_cells)
        return pairs, triples

    @cached_property
    def _pinches(self) -> Pinches:
        return pinches(self._context.hand, self._max_deg)

    @cached_property
    def _triads(self) -> Triads | None:
        return triads(self._context.hand, self._max_deg)

    def _about_pairs(self, pairs: ContactSets, drawn: Index) -> _Hands:
        """Hands of as many postures and rolls about each of the drawn pairs."""
        rng, table = self._context.rng, self._pinches
        p, q = (np.repeat(pairs.points[drawn, side], _ROLLS, axis=0) for side in (0, 1))
        width = np.linalg.norm(q - p, axis=1)
        low = np.searchsorted(table.width, width - _WIDTH_M)
        high = np.searchsorted(table.width, width + _WIDTH_M)
        # Where no grip is as wide, the nearest: the fingers close as far as they must.
        low, high = np.minimum(low, len(table.width) - 1), np.maximum(high, 1)
        rows = low + (rng.random(len(low)) * np.maximum(high - low, 1)).astype(np.intp)
        n = len(rows)
        axis = rng.choice([-1.0, 1.0], n)[:, None] * (q - p) / width[:, None]
        R = self._rolled(turned_onto(table.axis[rows], axis), axis)
        T = transform(R, 0.5 * (p + q) - np.einsum("nij,nj->ni", R, table.middle[rows]))
        cost = self._cost(T, table.points[rows], table.normals[rows], table.used[rows])
        owner = np.repeat(np.arange(len(drawn)), _ROLLS)
        return _Hands(T, table.preshape[rows], table.joints[rows], table.cell[rows], owner, cost)

    def _rolled(self, R: Array, axis: Array) -> Array:
        """Rotations (n, 3, 3) rolled about axes (n, 3): anyhow, or to come from where one may."""
        rng, n = self._context.rng, len(R)
        roll = rng.uniform(0.0, 2.0 * np.pi, n)
        wanted = self._fitting.approach_axis
        if wanted is not None:
            z = R[:, :, 2]
            along = np.einsum("ni,ni->n", axis, z) * (axis @ wanted)
            toward = np.arctan2(
                np.einsum("ni,ni->n", axis, np.cross(z, np.broadcast_to(wanted, z.shape))),
                z @ wanted - along,
            )
            near = rng.random(n) < _FROM_ALLOWED
            # Fingertips about a flat part have a few degrees to go, others tens of them.
            spread = _ROLL_RAD * rng.random(n) ** 2
            roll = np.where(near, toward + spread * rng.standard_normal(n), roll)
        return np.asarray(Rotation.from_rotvec(roll[:, None] * axis).as_matrix() @ R)

    def _about_triples(self, triples: ContactSets, drawn: Index) -> _Hands:
        """Hands of the nearest triads about each of the drawn triples."""
        table = self._triads
        assert table is not None
        of = triples.points[drawn][:, _ORDERS].reshape(-1, 3, 3)
        inward = -triples.normals_outward[drawn][:, _ORDERS].reshape(-1, 3, 3)
        _, nearest = table.tree.query(triangle_sides(of), k=_NEIGHBOURS)
        rows = nearest.reshape(-1)
        to, toward = (np.repeat(x, _NEIGHBOURS, axis=0) for x in (of, inward))
        T = fitted(table.points[rows], table.normals[rows], to, toward)
        used = np.ones((len(rows), 3), dtype=bool)
        cost = self._cost(T, table.points[rows], table.normals[rows], used)
        owner = np.repeat(np.arange(len(drawn)), len(_ORDERS) * _NEIGHBOURS)
        cell = self._first_triad + table.cell[rows]
        return _Hands(T, table.preshape[rows], table.joints[rows], cell, owner, cost)

    def _cost(self, T: Array, points: Array, normals: Array, used: NDArray[np.bool_]) -> Array:
        """How badly hands (n) touch the part with their places (n, S, 3): (n,), 0 is best."""
        R, t = T[:, None, :3, :3], T[:, None, :3, 3]
        x = np.einsum("nsij,nsj->nsi", R, points) + t
        outward = np.einsum("nsij,nsj->nsi", R, normals)
        _, surface_normal, distance = self._surface(x[used])
        opposed = np.einsum("mi,mi->m", outward[used], surface_normal)
        each = np.zeros(used.shape)
        each[used] = np.minimum(distance / _GAP_M, 2.0) + 1.0 + opposed
        cost = each.sum(axis=1) / used.sum(axis=1)
        face = T[:, :3, 3] + self._context.T_palm_face[2, 3] * T[:, :3, 2]
        depth, _, _ = self._surface(face)
        cost += np.maximum(-depth, 0.0) / _GAP_M
        axis = self._fitting.approach_axis
        if axis is not None:
            cost += 0.5 * _APPROACH * (1.0 - T[:, :3, 2] @ axis)
        return np.asarray(cost)

    def _surface(self, x: Array) -> tuple[Array, Array, Array]:
        """Height over the nearest sample's plane (n,), its normal (n, 3), and distance (n,)."""
        atlas = self._context.atlas
        index, nearest = atlas.nearest(x)
        normal = atlas.surface.normals_outward[index]
        offset = x - nearest
        return (
            np.einsum("ij,ij->i", offset, normal), normal, np.linalg.norm(offset, axis=1)
        )  # fmt: skip


def turned_onto(start: Array, end: Array) -> Array:
    """The smallest rotations (n, 3, 3) that take unit vectors to others (n, 3)."""
    axis = np.cross(start, end)
    sine = np.linalg.norm(axis, axis=1)
    cosine = np.einsum("ij,ij->i", start, end)
    other = np.eye(3)[np.argmin(np.abs(start), axis=1)]
    across = np.cross(start, other)
    axis = np.where((sine < 1e-9)[:, None], across, axis)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    turn = Rotation.from_rotvec(np.arctan2(sine, cosine)[:, None] * axis)
    return np.asarray(turn.as_matrix())


def fitted(points: Array, normals: Array, to: Array, toward: Array) -> Array:
    """Poses (n, 4, 4) that bring points to points (n, k, 3), and normals to directions.

    Least squares over both (Kabsch); a normal counts like a point `_GAP_M` away.
    """
    a, b = points.mean(axis=1, keepdims=True), to.mean(axis=1, keepdims=True)
    H = np.einsum("nki,nkj->nij", points - a, to - b)
    H += _GAP_M**2 * np.einsum("nki,nkj->nij", normals, toward)
    U, _, Vt = np.linalg.svd(H)
    V, Ut = np.swapaxes(Vt, 1, 2), np.swapaxes(U, 1, 2)
    V[:, :, 2] *= np.sign(np.linalg.det(V @ Ut))[:, None]
    T = np.zeros((len(points), 4, 4))
    T[:, :3, :3], T[:, 3, 3] = V @ Ut, 1.0
    T[:, :3, 3] = b[:, 0] - np.einsum("nij,nj->ni", T[:, :3, :3], a[:, 0])
    return T
