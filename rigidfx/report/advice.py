"""Advice in a run: which number is looked at, up to which bound, and the sentence beyond it.

docs/messages.py writes it into docs/messages.md. `Adviser`s compute the numbers.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.report.report import Look
from rigidfx.scene.scene import Scene
from rigidfx.step.length.given import SMOOTH

NOTICED = 0.05  # of the peak of a force, or of the energy of a body: what is worth a word, and ...
OF_ALL = 0.01  # ... of all such forces or energies
RESOLVED = 10  # steps of half a sine whose peak is known to some 3 %; half as many lose a tenth


@dataclass(frozen=True)
class Row:
    """One piece of advice."""

    bound: float  # the number up to which, or down to which, nothing is said
    of: str  # its unit, or the whole of which it is a part
    remedy: str  # in a few words, with a link into docs/
    sentence: str  # the message, with the names of its values


ADVICE = {
    "a force goes back and forth": Row(
        NOTICED,
        "of the resolved peak",
        "[`…_resolved`](results.md#forces-of-flexible-parts)",
        "Up to t = {t:.6g} s {name} goes back and forth from step to step by {swing:.3g} {unit}: "
        "its peak is {peak:.3g}, that of the motion that Δt resolves {resolved:.3g} "
        "{unit}{others}. Cells vibrate faster than Δt = {dt:.3g} s resolves. Pictures and the "
        "columns …_resolved of rf.read_history leave this vibration out, reports with "
        "rf.ResolvedForces() in the scene. Motions that begin smoothly vibrate less.",
    ),
    "a load or path changes faster than Δt": Row(
        SMOOTH,
        "of the load is missed",
        "the Δt of the message, [a `Table`](effects.md)",
        "{owner}: its {kind} changes faster than Δt = {dt:.3g} s, near t = {t:.6g} s within some "
        "{period:.2g} s. A step takes it in its middle, and misses {number:.0%} of it. Take Δt ≤ "
        "{short:.2g} s, a tenth of that, or StepControl; where it jumps or has kinks, since, "
        "until and rf.Table end steps there.",
    ),
    # A path that starts smoothly has a velocity by a difference quotient, whose error is 1e-6 of
    # that after a step. Where it rests, rounding leaves 1e-12 of its place in a step.
    "a load does nothing, nothing acts": Row(
        1e-9,
        "of a cell's size",
        "`describe()`: windows, [supports](effects.md), `t_end`",
        "Up to t = {t:.6g} s nothing acts and nothing moves: the scene has neither a load, nor a "
        "motion that is prescribed, nor a velocity or displacement at the start. Scene.describe() "
        "tells which effects act when.",
    ),
    "a support or contact acts with a jolt": Row(
        0.1,
        "of the energy",
        "[a path](effects.md) that starts smoothly, `InitialVelocity`",
        "At t = {t:.6g} s {names} acts with a jolt: an impact {gives} {energy:.3g} J{share} at "
        "one instant, and waves run from there.{follows} If no blow is meant, let a prescribed "
        "motion start from the velocity that the nodes have and grow over some periods of "
        "vibration (rf.Table, or a smooth path), give the whole body the motion of the support by "
        "InitialVelocity, or let a contact begin where nothing overlaps. The report has the "
        "impact in `impact`.",
    ),
    "a blow on a contact": Row(
        RESOLVED,
        "steps (half do)",
        "[the Δt of the message](contact.md)",
        "{told} within {steps}: Δt does not resolve this impact. Its impulse, {impulse:.3g} N s, "
        "and the motion afterwards hold; the peak of its force ({peak:.3g} N here, a mean over a "
        "step) and of stresses does not. With Δt ≤ {dt:.2g} s, a tenth of the half period of the "
        "layer of cells behind the contact, or of a rigid part, on its stiffness, or less, "
        "shorter steps change the peak of touch.resolved, the force's mean over {over}, by a few "
        "per cent at most; smaller cells may change it more. StepControl and Accuracy shorten "
        "steps at impacts; the error afterwards is not estimated.",
    ),
    "the peak of a contact's force": Row(
        1.1,
        "times the resolved peak",
        "[`touch.resolved`](contact.md#peaks-of-impacts), smaller cells",
        "{told}: the peak of its force, {peak:.3g} N, lasts for less than its cells resolve, as "
        "nodes of the surface ring on the contact. Take that of touch.resolved, {resolved:.3g} N: "
        "a mean over {over}, in which a wave crosses four layers of nodes. Smaller cells resolve "
        "shorter blows.",
    ),
    "a blow on a `Stop` or a cable": Row(
        RESOLVED,
        "steps (half do)",
        "shorter steps, [a softer stop](joints.md)",
        "{title} {how} at t = {t:.6g} s, in a blow of some {short:.2g} s: Δt does not resolve it. "
        "Its impulse and the motion afterwards hold; the peak of its force or torque ({peak:.3g} "
        "here, a mean over a step) does not. With Δt ≤ {dt:.2g} s the peak is found to a few per "
        "cent; a smaller `stiffness` makes blows longer.",
    ),
    "a blow on a `Stop`": Row(
        RESOLVED,
        "steps, in a run of one",
        "[shorter steps](joints.md)",
        "{title} {how} in the only step of the run, which does not show how long the blow is: the "
        "peak of its force or torque ({peak:.3g} here, a mean over a step) may be higher. Take "
        "shorter steps.",
    ),
    "lumped masses of a thin body": Row(
        NOTICED,
        "of the body's kinetic energy",
        '[`mass="consistent"`](rigid_parts.md), more cells across',
        "Body '{name}': {number:.0%} of its kinetic energy at t = {t:.6g} s is an error of its "
        "lumped masses, which give it up to {ratio:.3g} times the moment of inertia of its cells "
        "(about the axis it is thinnest around). Energies and angular momenta are conserved all "
        "the same. Take more cells across it, mass='consistent', or order=2 with hexahedra; or "
        "give the inertia of a named body (Rigid).",
    ),
    # Springs that give back all of a spin may stop it before it is a radian.
    "nodes of a spring rotate": Row(
        0.3,
        "rad",
        "nodes on the axis, [a joint](joints.md), a `SpringDamper`",
        "Spring on '{where}': at t = {t:.6g} s its nodes have turned by {number:.2g} rad, and "
        "each is pulled back to where it began: {energy:.3g} J are stored by the rotation alone, "
        "as in a torsional spring. For a bearing, take the nodes on the axis (with_vertices), or "
        "a Contact with Cylinder(inside=True); see docs/recipes.md.",
    ),
    # Four orders above what Newton's tolerance leaves.
    "the balance of energy is off": Row(
        1e-4,
        "of the largest energy",
        "[the message names the cause](limits.md#rounding)",
        "At t = {t:.6g} s the balance of energy is off by {number:.1e} of the largest energy. "
        "{why}",
    ),
    "the balance of energy is lost": Row(
        1.0,
        "of all energy and work",
        "a smooth energy, [smaller ratios of stiffness](limits.md#rounding)",
        "{lost}: the balance of energy is lost, and what follows is no motion of this scene. Look "
        "for the cause before anything else: a stored energy of one's own that is not smooth, or "
        "is called quadratic and is not; parts that are stiff beyond measure; a "
        "-rigidfx_snes_rtol that is too large.",
    ),
    "rounding dominates energies": Row(
        1e-2,
        "of the largest energy",
        "[`StVenantKirchhoff`](limits.md#rounding)",
        "The energies of this run are rounding to {number:.0%}: its largest is {largest:.1e} J, "
        "and a stored energy other than a quadratic one is known to {known:.1e} J at best, a "
        "small difference of numbers near one times its stiffness. Energy and its balance tell "
        "nothing here. Forces are known better; StVenantKirchhoff knows its energy at any strain.",
    ),
}


class Adviser(Look):
    """A look that says each sentence once.

    Attributes:
        said: Names of rows that need no more look.
    """

    remembered: ClassVar[Remembered] = same("said")

    def __init__(self, scene: Scene) -> None:
        self._scene, self._comm = scene, scene.comm
        self.said: set[str] = set()

    def advise(self, row: str, **values: Any) -> None:
        """Warn on rank 0, and never again by this row."""
        self.said.add(row)
        warn(self._comm, ADVICE[row].sentence.format(**values))
