"""What bodies lack, as joints and springs keep it.

Responses of parts that no support holds are without rigid motions, by mass. A joint that stays
closed, or a spring, may move the part on by many times as much. So groups of connected parts go by
rigid motions that close joints, and of these by such that springs bear what they bore, for that
rests or varies slowly; of all by the least one by mass.
"""

from collections.abc import Set

import numpy as np

from rigidfx.base.types import Array
from rigidfx.coupling.groups import HELD, Groups
from rigidfx.effects import Spring
from rigidfx.shapes.orthonormal import columns
from rigidfx.shapes.responses import Responses
from rigidfx.step.equations.supports import PrescribedDofs, supports_of
from rigidfx.step.stepper import Stepper
from rigidfx.switch.closed_joints import LEAST, ClosedJoints, turned


def kept(stepper: Stepper, growing: Set[int], responses: Responses, e: Array) -> Array:
    """A small displacement of the start, (owned nodes, 3) [m], as it is in the state. Collective.

    Bodies that deform are known by their numbers, responses are those about the start.
    """
    scene, state, acting = stepper.scene, stepper.state, stepper.system.acting
    springs = [own for own in scene.named(Spring) if own.face is None]
    if stepper.system.linkage is None and not springs:
        return e
    state.rebuild()
    x, bodies = np.array(state.places), state.bodies
    groups = Groups(scene, bodies, PrescribedDofs(scene, supports_of(acting)).mask.reshape(-1, 3))
    motions = groups.motions(x, bodies)
    d: Array = np.einsum("nab,nb->na", turned(scene, responses.stiffness.places, x), e)
    led = groups.led(np.arange(len(x)), x, motions)
    free, c = motions.even, np.zeros(led.shape[2])
    stiffness, pull = np.zeros((c.size, c.size)), np.zeros(c.size)
    for own in springs:
        shares = scene.shares(str(own.where), own.kind)[: len(x)]
        weighted = columns(shares[:, None, None] * (own.K @ led)).T
        stiffness += scene.sum(weighted @ columns(led))
        pull += scene.sum(weighted @ d.reshape(-1))
    if stepper.system.linkage is not None:
        joints = ClosedJoints(scene, state, growing, acting, responses)
        (A, opened), (by_c, by_d) = joints.slopes(d, motions)
        U, sizes, V = np.linalg.svd(A @ free)
        n = np.count_nonzero(sizes > LEAST * sizes.max(initial=0.0))
        c -= free @ V[:n].T @ (U[:, :n].T @ opened / sizes[:n])
        free = free @ V[n:].T
        stiffness += by_c.T @ by_c
        pull += by_c.T @ by_d
    of_free = np.linalg.pinv(free.T @ stiffness @ free, HELD, hermitian=True)
    c -= free @ of_free @ free.T @ (pull + stiffness @ c)
    return np.asarray(d + led @ c)
