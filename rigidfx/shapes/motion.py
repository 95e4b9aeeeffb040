"""Patterns of forces by motion: supports that move, spin, and a state that is not in balance.

With r the rates of a rigid motion that supports prescribe to a part, it bears inertia -M r, and
-M (ω × r) by its spin ω. The motion of a part that is held is that of its frame. A motion of
supports beside r, e at held dofs, pulls at the nodes beside them by -K e. A state that strains or
moves has its internal forces and momenta M v, which make it vibrate where they are not in balance.
"""

import numpy as np

from rigidfx.base.types import Array, Bools
from rigidfx.coupling.dof_layout import nodes_of, split
from rigidfx.coupling.rows import Rows
from rigidfx.mechanics.rigid_motions import fitted_motion
from rigidfx.shapes.orthonormal import columns
from rigidfx.shapes.responses import Responses
from rigidfx.shapes.samples import compressed, instants
from rigidfx.shapes.stiffness import times
from rigidfx.state import State
from rigidfx.step.equations.division import Hold

# Kinetic energy of the rotation over that of a rigid motion, and square of a motion of supports
# that is not rigid over that of all: below, a pattern is left out.
SMALL = 1e-4


def of_supports(
    responses: Responses, span: tuple[float, float], hold: Hold | None = None
) -> list[Array]:
    """Patterns by the supports that act in a span [s]; none if no support moves. Collective.

    `hold` are the supports in the part that bears the forces. Each has the shape (owned nodes, 3,
    k).
    """
    scene, stiffness = responses.scene, responses.stiffness
    held, u = stiffness.prescribed, stiffness.structure.u
    if not held.moves:
        return []

    def rates_at(t: float) -> Array:
        return held.velocities(t, span[1] - span[0], u)

    ts = instants(scene, held.active, span, rates_at)
    if not ts.size:
        return []
    rates = np.stack([rates_at(t) for t in ts], axis=1)
    V = responses.rigid.all
    on_held = columns(V)[held.mask]
    leads: Bools = np.ones(len(on_held), dtype=bool)
    if hold is not None:
        own = [
            dofs
            for s, (_, dofs) in zip(held.active, held.of_each(), strict=True)
            if s is hold.frame
        ]
        leads = np.isin(np.flatnonzero(held.mask), np.concatenate([*own, np.empty(0)]))
    rigid = fitted_motion(on_held[leads], rates[leads], scene.sum)
    out = [compressed(scene, responses.inertia(V @ rigid)), _spun(responses, V, rigid)]
    left = rates - on_held @ rigid
    if scene.sum((left**2).sum()) > SMALL * scene.sum((rates**2).sum()):
        e = np.zeros((scene.owned_nodes, 3, ts.size))
        columns(e)[held.mask] = left
        out.append(compressed(scene, pulled(responses, e)))
    return out


def _spun(responses: Responses, V: Array, rigid: Array) -> Array:
    """Patterns M (ω × r) of rigid motions V of the parts that spin, by coefficients. Collective."""
    turning = rigid.reshape(-1, 6, rigid.shape[1]).copy()
    turning[:, :3] = 0.0
    r, rotation = V @ rigid, V @ turning.reshape(rigid.shape)
    energies = [np.diag(responses.dot(u, responses.inertia(u))) for u in (r, rotation)]
    some = energies[1] > SMALL * energies[0]
    omega = responses.rigid.spins(rigid[:, some])
    F = responses.inertia(np.asarray(np.cross(omega, r[:, :, some], axis=1), dtype=np.float64))
    return compressed(responses.scene, F)


def pulled(responses: Responses, e: Array) -> Array:
    """Forces -K e of cells on nodes by displacements e, shape (owned nodes, 3, k). Collective."""
    scene, stiffness = responses.scene, responses.stiffness
    moved = np.flatnonzero(e.any(axis=(1, 2)))
    _, cells = split(scene, stiffness.cells, moved)
    nodes = np.flatnonzero(nodes_of(scene, cells)[: scene.owned_nodes]).astype(np.int32)
    rows = Rows(scene.space, nodes)
    K, F = rows.assembled(stiffness.linear.tangent(cells)), np.zeros_like(e)
    F[nodes] = -times(K, columns(e[nodes]), rows.vector).reshape(-1, *e.shape[1:])
    K.destroy()
    return F


def of_state(responses: Responses, state: State) -> list[Array]:
    """Patterns by the strains, the velocities and the spin of a state. Collective."""
    scene = responses.scene
    v = state.velocities(np.arange(scene.owned_nodes))[:, :, None]
    f = responses.rigid.internal[:, :, None]
    if not scene.sum((v**2).sum()) > 0:
        return [f]
    V, momenta = responses.rigid.all, responses.inertia(v)
    gram = responses.dot(V, responses.inertia(V))
    rigid = np.linalg.pinv(gram, hermitian=True) @ responses.dot(V, momenta)
    return [f, momenta, _spun(responses, V, rigid)]
