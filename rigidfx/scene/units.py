"""Signs that numbers of a scene are not in SI units.

A part read in millimetres in place of metres has 1e9 times its mass, so that forces that are meant
for it are next to nothing beside its weight. Those on large structures are not, and neither are
forces on parts in micrometres. Without forces its Δt tells: waves take a thousand times as long
through the part, which a hall that shakes has Δt for.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.inputs import numbers
from rigidfx.base.warning import warn
from rigidfx.effects import Contact, Gravity, NodalForce, Resultant, SpringDamper, Support, Table
from rigidfx.effects.damping import warn_of_ratio
from rigidfx.scene.weights import inertial_masses

NOTHING = 1e-5  # of a scene's weight: a walker on a large bridge has more
HEAVY = 1e7  # kg: a steel part of 0.1 m weighs more if millimetres are taken for metres
LIGHT = 0.1  # kg/m³: aerogels have 1
FASTEST = 3e8  # m/s, of light
MILLI = 1e3  # of a metre
INSTEAD = "They have to be in metres (scale=1e-3 where a mesh is read), with Pa, kg/m³ and N."


def warn_of_units(scene: Any) -> None:
    """Warn of masses, forces, dampers and gravity that hardly go together. Collective."""
    mass = scene.sum(inertial_masses(scene).sum())
    earth = float(np.linalg.norm(numbers(Gravity().value)))
    most, least = _largest_force(scene), NOTHING * earth * mass
    if 0 < most < least:
        warn(
            scene.comm,
            f"Scene: its forces of {most:.3g} N at most are next to nothing beside its weight, as "
            f"its mass is {mass:.3g} kg. Are lengths in millimetres? {INSTEAD}",
        )
    elif mass > HEAVY and not (most > 0 or any(s.moves for s in scene.named(Support))):
        warn(scene.comm, f"Scene: its mass is {mass:.3g} kg. Are lengths in millimetres? {INSTEAD}")
    for spring in scene.named(SpringDamper):
        if spring.stiffness > 0 and not spring.pulls_only:  # a cable may stop what flies
            ratio = 0.5 * spring.damping / float(np.sqrt(spring.stiffness * mass))
            warn_of_ratio(scene.comm, f"{spring.owner} under all mass", ratio)
    cells = scene.mesh.topology.index_map(3).size_global
    rho = mass / (cells * scene.mean_cell_size**3)  # with all masses that are given
    speed = min(float(np.sqrt(m.stiffness / m.rho)) for m, _ in scene.materials)
    if speed > FASTEST:  # one that is stiff on purpose may be so, not all
        warn(
            scene.comm,
            f"Scene: waves pass its softest material at {speed:.2g} m/s, faster than light. Moduli "
            "in Pa go with kg/m³, those in MPa with t/mm³.",
        )
    for gravity in scene.named(Gravity):
        g = np.inf if callable(gravity.value) else float(np.linalg.norm(gravity.value))
        if rho >= LIGHT and MILLI / 10 < g / earth < 10 * MILLI:
            warn(
                scene.comm,
                f"{gravity.owner}: {g:g} is in m/s², where earth has {earth:g}; 9810 mm/s² goes "
                f"with densities in t/mm³, and the density here is {rho:.3g} kg/m³.",
            )
        if rho < LIGHT and earth < 10 * g and g < 10 * earth:
            warn(
                scene.comm,
                f"{gravity.owner}: {g:g} is in m/s², and the density {rho:g} hardly is in kg/m³. "
                "With t/mm³, MPa, mm, N and s take 9810; with kg/mm³, GPa, mm, kN and ms 0.00981.",
            )


def warn_of_short_steps(scene: Any, dt: float) -> None:
    """Warn of a heavy body without forces whose waves take hundreds of steps. Collective.

    Those in which waves are of interest pass a cell in a few steps.

    Args:
        scene: The scene.
        dt: Δt of its run [s].
    """
    mass = scene.sum(inertial_masses(scene).sum())
    if MILLI * mass < HEAVY or _largest_force(scene) > 0 or scene.named(Contact):
        return
    speed = max(float(np.sqrt(m.stiffness / m.rho)) for m, _ in scene.materials)
    X = scene.mesh.geometry.x
    ends = np.r_[X.max(axis=0, initial=-np.inf), -X.min(axis=0, initial=np.inf)]
    scene.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
    length = float(np.max(ends[:3] + ends[3:]))
    if 3 * length > MILLI * speed * dt and scene.mean_cell_size > 10 * speed * dt:
        warn(
            scene.comm,
            f"simulate: a wave needs {length / (speed * dt):.3g} steps of Δt = {dt:.3g} s through "
            f"the {length:.4g} m of this scene of {mass:.3g} kg. Are lengths in millimetres? "
            f"{INSTEAD}",
        )


def _largest_force(scene: Any) -> float:
    """That of loads on nodes and bodies [N]."""
    kinds = NodalForce, Resultant
    return max((_largest(effect) for kind in kinds for effect in scene.named(kind)), default=0.0)


def _largest(effect: Any) -> float:
    """The largest force of a load [N]; inf if a function tells it."""
    force = effect.force if hasattr(effect, "force") else effect.value
    if callable(force) or not isinstance(effect.time, Table | None):
        return np.inf
    factor = 1.0 if effect.time is None else float(np.abs(effect.time.values).max())
    return factor * float(np.linalg.norm(force))
