"""How far shapes hold, as bodies of a run bend.

ν is how far a body is from the energy that its shapes have. It grows with ½ e·Ωe, and with q·Dq,
the square of their displacement by mass: the energy of a bar that is stretched hardly changes as it
begins to bend. It is looked at again once one of them has doubled, or grown as much as ν lacks to
its bound, for named parts; where displacements are bounded, also once forces that shapes lack have.

A strip that is pulled is harder to bend, and so is one that spins on a hinge, pulled by its own
inertia. Where stresses change the stiffness of any shape by more than 3 `BOUND`, a body gets Γ,
see `rigidfx.mechanics.shapes`, which takes an assembly for each shape. So it does where joints or
springs would stress it as it bends: without Γ they do not feel that it gets shorter. A displacement
that shapes lack becomes a shape where its stresses bend the body by more than is allowed. Named
parts are asked in each step, with `BOUND`, as a pull may have little energy beside that of a bend.
Above the bound of ν cells of bodies that were found wake; for named parts the run warns, each time
that ν has grown eightfold.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from rigidfx.base.log import tell
from rigidfx.base.remembered import ON_CELLS, PART, Remembered, same
from rigidfx.base.types import TINY, Array, Bools, Indices
from rigidfx.base.warning import warn
from rigidfx.coupling.dof_layout import AtNodes, nodes_of
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body
from rigidfx.scene.scene import Scene
from rigidfx.shapes.excess import (
    About,
    Excess,
    Unrelieved,
    deformed,
    self_stresses,
    softest,
    unrelieved,
)
from rigidfx.shapes.expanded import Expanded
from rigidfx.shapes.part import MOST
from rigidfx.shapes.responses import LACKING
from rigidfx.state import State

BOUND = 0.003  # of ν, above which cells wake, and a run warns: amplitudes err by 0.9 %
# The same of bodies that no support holds, where displacements are bounded by 3 ν of the bend. One
# that supports stretched erred by 1.07 % where 1 % was asked.
FARTHEST = 0.03
# Factors of ½ q·Ωq or q·Dq after which ν is looked at again: near its bound, and at most.
NEAR, FAR = 2.0, 64.0
AGAIN = 8.0  # factor by which ν has to grow for the next warning
SHARE = 0.3  # part of the largest miss of any cell, over its volume, above which cells wake
# Part of the largest ½ q·Ωq so far, and of a body's length, up to which ν is not looked at: where a
# bar bends by so much of its length, ν is 1e-6 if it is a thousand times as long as thick.
LEAST = 1e-6
SOFTEST = 3  # shapes of a named part whose stiffness is asked for in each step
ROUNDING = float(np.sqrt(np.finfo(np.float64).eps))  # of q, over the length of a body


def off_by(ratio: float) -> float:
    """Bound of the relative error of amplitudes, by the share of energy that shapes lack: ν.

    With ν forces err by 2 ν where the energy has a fourth order.
    """
    return 3 * ratio


def tightens(body: Body, part: Expanded, d: Array, allowed: float | None = None) -> bool:
    """Whether stresses of d, (nodes, 3) [m], change the stiffness of shapes by much. Collective.

    If a displacement is allowed [m], it is much where the body bends by more than that.
    """
    shapes, q = body.data.shapes, body.motion.q
    assert shapes is not None
    (change,) = part.tension_by(d[:, :, None], shapes.whole.swapaxes(1, 2))
    stiffness = shapes.tightened(q)
    if allowed is not None:
        bend = np.asarray(np.linalg.solve(stiffness, change @ q), dtype=np.float64)
        return part.largest(deformed(body, bend)) > allowed
    parts = np.linalg.eigvals(np.linalg.solve(stiffness, change))
    return bool(np.abs(parts).max() > off_by(BOUND))


def lacks_tension(body: Body) -> bool:
    """Whether a body has shapes without Γ."""
    shapes = body.data.shapes
    return shapes is not None and (shapes.tension is None or len(shapes.tension) < len(shapes))


def stresses(body: Body) -> Array:
    """Displacement of a body that stresses it, Φe, shape (nodes, 3) [m]."""
    return deformed(body, body.stretched[0])


def tense(body: Body, part: Expanded, known: int = 0) -> Body:
    """A body with Γ of all its shapes. Collective.

    That of stresses of the first ones, which are known, stays: they stiffen further shapes, of
    tension, by little.
    """
    shapes = body.data.shapes
    assert shapes is not None
    before = (
        np.zeros((0, 0, 0)) if shapes.tension is None else shapes.tension[:known, :known, :known]
    )
    return body.with_shapes(replace(shapes, tension=tension_of(body, part, before)))


def tension_of(body: Body, part: Expanded, known: Array) -> Array:
    """Γ of a body's shapes, of which that of the first ones is known, (m, m, m). Collective."""
    shapes, n = body.data.shapes, len(known)
    assert shapes is not None
    modes = shapes.whole.swapaxes(1, 2)
    tension = np.zeros(3 * (len(shapes),))
    tension[:n, :n, :n] = known
    tension[n:] = part.tension_by(modes[:, :, n:], modes)
    return tension


class Looks:
    """Says when ν of a body is to be looked at."""

    remembered: ClassVar[Remembered] = same("_next", "_largest")

    def __init__(self) -> None:
        # ½ q·Ωq and q·Dq of each body, by number, above which ν is looked at again [J, kg m²], and
        # the size of forces that shapes lack [N/√kg].
        self._next: dict[int, tuple[float, float, float]] = {}
        self._largest = 0.0  # strain energy of any body so far [J]

    def due(self, body: Body, pull: float = 0.0) -> bool:
        """Whether ν of a body is to be looked at now. Shapes lack forces of size `pull` [N/√kg]."""
        data, shapes, q = body.data, body.data.shapes, body.motion.q
        if shapes is None:
            return False
        energy, square = _sizes(body)
        self._largest = max(self._largest, energy, data.frozen.strain)
        if np.abs(q).max() <= LEAST * data.length or energy <= LEAST * self._largest:
            return False
        known = self._next.get(data.number, (0.0, 0.0, 0.0))
        return energy > known[0] or square > known[1] or pull > known[2]

    def looked(self, body: Body, grown: float, pull: float = 0.0) -> None:
        """ν of a body was looked at; it is again once one of its sizes has grown by a factor."""
        energy, square = _sizes(body)
        self._next[body.data.number] = grown * energy, grown * square, grown * pull

    def forget(self, number: int) -> None:
        """Forget a body that is no more."""
        self._next.pop(number, None)


def _sizes(body: Body) -> tuple[float, float]:
    """½ e·Ωe of its stretches and q·Dq [J, kg m²]."""
    shapes, q, (e, _) = body.data.shapes, body.motion.q, body.stretched
    assert shapes is not None
    return 0.5 * float(e @ shapes.stiffness @ e), float(q @ shapes.mass @ q)


def _named(bodies: Bodies) -> list[Body]:
    """The bodies with shapes that are named `Reduced`."""
    each = bodies if bodies.of.shapes is not None else ()
    return [body for body in each if body.data.named and body.data.shapes is not None]


class Spent:
    """ν of the parts of a run that are named `Reduced`.

    Attributes:
        nu: ν of each part, the largest so far, by its name.
        leaving: Which owned cells leave parts before the next step.
    """

    remembered: ClassVar[Remembered] = same("nu", "_rise", "_told", "_draws") | {
        "_looks": PART,
        "leaving": ON_CELLS,
    }

    def __init__(self, scene: Scene, about: Callable[[Body], About]) -> None:
        """Nothing has been looked at; `about` expands a part, collectively."""
        self._scene, self._about, self._looks = scene, about, Looks()
        self.nu: dict[str, float] = {}
        self._rise: dict[str, float] = {}  # ν over q·Dq when it was looked at [1/(kg m²)]
        self._told: dict[str, float] = {}  # ν of which the last warning told, of each part
        # By how much they would be stiffer if joints kept them from getting shorter, likewise
        self._draws: dict[str, float] = {}
        # Energy of self-stresses over the square of that of a bend, by names and cells [1/J];
        # infinite once it has counted.
        self._held: dict[tuple[str, int], float] = {}
        # How stretches stiffen the softest shapes, per e, by name, cells and shapes [1/m].
        self._stiffer: dict[tuple[str, int, int], Array] = {}
        owned = scene.mesh.topology.index_map(3).size_local
        self.leaving: Bools = np.zeros(owned, dtype=bool)

    def follow(self, state: State, pressed: Mapping[str, Bools] | None = None) -> dict[str, float]:
        """ν of each part, but those that are to get Γ. Collective.

        Where owned nodes are pressed, cells at these may leave a part: see `leaving`.
        """
        for body in _named(state.bodies):
            name, (_, square) = body.data.name, _sizes(body)
            marks, taut = (pressed or {}).get(name), self._tightens(body)
            if (not taut or marks is not None) and self._looks.due(body):
                found = Excess(self._about(body), body)
                leaves = marks is not None and self._leave(body, found, marks)
                if not (leaves or taut):
                    self._look(state.t, body, found)
                self._draws[name] = self._stiffens(body, found.drawn) / square
                self._rise[name] = found.nu / square
            if not taut:
                self.nu[name] = max(self.nu.get(name, 0.0), self._rise.get(name, 0.0) * square)
        return dict(self.nu)

    def _leave(self, body: Body, found: Excess, pressed: Bools) -> bool:
        """Whether cells of a body leave it, as they are pressed. Collective.

        They are those with most of ν, if they alone have `SHARE` of its bound or more, as long as
        few nodes are pressed or belong to cells that have left.
        """
        scene = self._scene
        cells = found.most(SHARE)
        cells = cells[at_cells(scene, pressed.astype(np.float64), cells) > 0]
        loose = pressed | nodes_of(scene, {0: cells})[: scene.owned_nodes]
        few = (
            scene.sum(np.count_nonzero(loose)) <= 3 * MOST
            and 2 * scene.sum(cells.size) <= body.data.size
        )
        if not few or found.within(cells) * found.nu < SHARE * BOUND:
            return False
        self.leaving[cells] = True
        return True

    def left(self, number: int) -> None:
        """Cells have left a body: ν is another one."""
        self._looks.forget(number)

    def taut(self, bodies: Bodies) -> frozenset[str]:
        """Names of the parts that are to get Γ, as stresses stiffen them. Collective."""
        return frozenset(body.data.name for body in _named(bodies) if self._tightens(body))

    def _tightens(self, body: Body) -> bool:
        """Whether stresses stiffen one of the softest shapes by much, without Γ. Collective."""
        if np.abs(body.motion.q).max() <= ROUNDING * body.data.length:
            return False
        if self._lacks_selves(body):
            return True
        if not lacks_tension(body):
            return False
        held = self._draws.get(body.data.name, 0.0) * _sizes(body)[1]
        return max(held, self._stiffens(body, body.stretched[0])) > BOUND

    def _lacks_selves(self, body: Body) -> bool:
        """Whether supports stress a body as it bends, and it is without self-stresses. Collective.

        Those at several places pull at it: they bring Γ.
        """
        shapes = body.data.shapes
        return (
            shapes is not None
            and shapes.selves is None
            and (shapes.given > 0 or self.withholds(body))
        )

    def withholds(self, body: Body) -> bool:
        """Whether supports keep nodes from relieving its strains of second order. Collective.

        They do where self-stresses would have a millionth of its energy, if all of this were that
        of the softest shape, and from then on: a bar between flexible cells errs by 1.2, 0.15,
        0.03 % where they begin at 1e-4, 1e-6, 1e-8, as they are zero then.
        """
        shapes, key = body.data.shapes, (body.data.name, body.data.size)
        assert shapes is not None
        if key not in self._held:
            about, self._held[key] = self._about(body), 0.0
            if shapes.drift is not None or about.on_supports:
                bend = Unrelieved.of(about, shapes, int(softest(shapes, 1)[0]))
                stress = self_stresses(about, shapes, [bend]).of(bend.q)
                bent = 0.5 * float(bend.q @ shapes.stiffness @ bend.q)
                self._held[key] = 0.5 * float(stress @ stress) / bent**2
        if _sizes(body)[0] > LACKING**3 / max(self._held[key], TINY):
            self._held[key] = np.inf
        return self._held[key] == np.inf

    def _stiffens(self, body: Body, e: Array) -> float:
        """By which part a stretch stiffens one of the softest shapes at most. Collective."""
        shapes = body.data.shapes
        assert shapes is not None
        key = body.data.name, body.data.size, len(shapes)
        if key not in self._stiffer:
            self._stiffer[key] = self._about(body).part.stiffer(shapes, softest(shapes, SOFTEST))
        return float(np.abs(self._stiffer[key] @ e).max())

    def tense(self, bodies: Bodies, taut: frozenset[str]) -> Bodies:
        """The bodies, some with Γ, by their names. Collective."""
        for name in sorted(taut):
            tell(self._scene.comm, f"Reduced '{name}': tension stiffens it from now on")
        each = [self._tense(b) if b.data.name in taut else b for b in bodies]
        return Bodies.of_each(each)

    def _tense(self, body: Body) -> Body:
        """A body with Γ, and with self-stresses, if it asks for them. Collective."""
        about = self._about(body)
        made = tense(body, about.part) if lacks_tension(body) else body
        shapes = made.data.shapes
        if shapes is None or not self._lacks_selves(body):
            return made
        selves = self_stresses(about, shapes, unrelieved(about, shapes))
        return made.with_shapes(replace(shapes, selves=selves))

    def _look(self, t: float, body: Body, found: Excess) -> None:
        """Warn where ν of a part is not small, and again as it has grown by `AGAIN`. Collective."""
        name = body.data.name
        # Parts of ν have signs: one look may find little where they change.
        largest = max(found.nu, self.nu.get(name, 0.0), BOUND / FAR)
        self._looks.looked(body, max(NEAR, BOUND / largest))
        if found.nu <= max(BOUND, AGAIN * self._told.get(name, 0.0)):
            return
        self._told[name] = found.nu
        count, lower, upper = found.spent(SHARE)
        least = ROUNDING * np.abs(upper - lower).max()
        ends = [np.where(np.abs(end) < least, 0.0, end) for end in (lower, upper)]
        box = " to ".join("(" + ", ".join(f"{x:.4g}" for x in end) + ")" for end in ends)
        warn(
            self._scene.comm,
            f"Reduced '{name}': at t = {t:.4g} s it deforms too far for its shapes. The "
            f"energy or the forces of its cells differ by ν = {found.nu:.2%}: amplitudes "
            f"err by some {off_by(found.nu):.1%}, frequencies by a quarter of that. Most of it is "
            f"in {count} cells, those within {box} m. Keep these flexible: take them out of the "
            "set of the Reduced.",
        )


def at_cells(scene: Scene, values: Array, cells: Indices) -> Array:
    """The largest of values at owned nodes in each of some owned cells. Collective."""
    at = AtNodes(scene).of_owners(values)[scene.space.dofmap.list[cells]]
    return np.asarray(at.max(axis=1, initial=0.0))
