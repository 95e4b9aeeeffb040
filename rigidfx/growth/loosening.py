"""Cells of a named part that leave it where a contact presses it farther than its shapes follow.

A body without some cells has the same places and velocities: its shapes are those that it had, at
the nodes that are left. They are made orthonormal by the mass of these, x = c + R (ξ + Φ q) with

    Φ' = (Φ - φ) T,    q' = T⁻¹ q,    c' = c + R (d + φ q),

where d and φ are the means of ξ and Φ by the mass that is left. The energy that cells have beside
U(q) of the body before stays with the strain energy of the body, so that none is lost or gained.
"""

from dataclasses import replace

import numpy as np
from dolfinx import fem

from rigidfx.base.types import Array, Indices
from rigidfx.coupling.dof_layout import nodes_of
from rigidfx.decide.bodies import PlannedBody
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.inventory.mass_properties import data_of, excess_of_lumping, mass_properties
from rigidfx.mechanics.rigid_body import NOTHING, Body, BodyMotion, RigidBody
from rigidfx.mechanics.shapes import Shapes, ShapesOfBodies
from rigidfx.scene.scene import Scene
from rigidfx.shapes.expanded import Expanded
from rigidfx.shapes.orthonormal import INDEPENDENT
from rigidfx.shapes.part import Part
from rigidfx.shapes.responses import Responses
from rigidfx.state import State


class Loosening:
    """Takes cells out of bodies, about a structure's responses."""

    def __init__(self, scene: Scene, forces: InternalForces, responses: Responses) -> None:
        self._scene, self._forces, self._responses = scene, forces, responses

    def without(self, state: State, body: Body, cells: Indices) -> tuple[Body, Part]:
        """A body without some of its owned cells, and its matrices. Collective.

        Displacements of its nodes are up to date in the state.
        """
        forces, data, before = self._forces, body.data, body.data.shapes
        assert before is not None
        rest = np.setdiff1d(data.cells, cells)
        inside = nodes_of(self._scene, forces.cells(rest))[data.nodes]
        nodes = data.nodes[inside]
        part = Part(self._responses, forces.cells(rest), nodes, data.name)
        made = self._data(data, rest, nodes, cells)
        modes = before.whole[inside].swapaxes(1, 2)
        images = part.times_mass(modes)
        mean = np.asarray(self._scene.sum(images.sum(axis=0))).T / made.mass
        T, back = self._turn(part.dot(modes, images), mean, made.mass, before.given)
        fields, found = np.asarray((modes - mean.T) @ T), part.projected(np.asarray(modes @ T))
        own, moments = fields.swapaxes(1, 2).copy(), part.moments(made.offsets, fields)
        tension = before.tension
        if tension is not None:
            tension = self._tension(data, before, cells)
            tension = np.einsum("ajk,ax,jy,kz->xyz", tension, T, T, T, optimize=True)
        shapes = Shapes(
            *(nodes, own, moments, found.stiffness, found.force),
            drift=None if before.drift is None else T.T @ mean,
            tension=tension,
            shorter=None if before.shorter is None else back @ before.shorter,
            given=before.given,
            selves=None if before.selves is None else before.selves.turned(T, back, inside),
        )
        drift = np.zeros(mean.shape) if before.drift is None else before.drift
        motion = _moved(body, made.origin - data.origin, np.asarray(mean - drift), back)
        kept = data.frozen.strain + _energy(before, body.motion.q)
        kept -= _energy(shapes, motion.q) + self._energy(state, cells)
        made = replace(made, shapes=shapes, frozen=replace(NOTHING, strain=kept))
        return Body(made, motion), part

    def _energy(self, state: State, cells: Indices) -> float:
        """Strain energy of some owned cells in a state [J]. Collective."""
        form = self._forces.bind_energy(self._forces.cells(cells), state.u)
        return float(self._scene.sum(fem.assemble_scalar(form)))

    def _data(self, data: RigidBody, cells: Indices, nodes: Indices, leaving: Indices) -> RigidBody:
        """Constant data of a body's cells without those that leave, and its shapes. Collective."""
        scene, at, excess = self._scene, self._forces.cells(cells), data.excess
        x, u = np.zeros((2, scene.owned_nodes, 3))
        x[data.nodes], u[data.nodes] = data.origin + data.offsets, data.displacement
        p = mass_properties(scene, at, nodes, x, 0 * x)
        if scene.mass == "lumped":
            start = self._responses.stiffness.linear.shape.x.array.reshape(-1, 3)
            places = scene.space.tabulate_dof_coordinates() + start
            excess = excess - excess_of_lumping(scene, leaving, places)
        more = {"size": int(scene.sum(cells.size)), "named": data.named, "excess": excess}
        what = PlannedBody(cells, nodes, data.name, data.number, data.named)
        return data_of(what, x, u, p.mass, p.inertia, p.centre, **more)

    def _turn(self, D: Array, mean: Array, mass: float, given: int) -> tuple[Array, Array]:
        """T and T⁻¹, (m, n) and (n, m), by products of shapes and their means. Collective.

        Shapes that supports give stay as they are.
        """
        G = (D - mass * mean @ mean.T)[given:, given:]
        size = np.sqrt(np.maximum(np.diag(G), 0.0))
        scaled = np.linalg.eigh(G / np.outer(size, size))
        values, vectors = self._scene.comm.bcast(scaled)
        some = vectors[:, values > INDEPENDENT**2]
        T = np.eye(len(D), given + some.shape[1])
        T[given:, given:] = some / size[:, None]
        back = np.eye(T.shape[1], T.shape[0])
        back[given:, given:] = some.T * size
        return T, back

    def _tension(self, data: RigidBody, shapes: Shapes, cells: Indices) -> Array:
        """Γ of a body's shapes without some cells, shape (m, m, m) [N/m²]. Collective."""
        assert shapes.tension is not None
        scene, linear = self._scene, self._responses.stiffness.linear
        leaving = self._forces.cells(cells)
        inside = nodes_of(scene, leaving)[data.nodes]
        nodes = data.nodes[inside]
        start = linear.shape.x.array.reshape(-1, 3)[nodes]
        few = Expanded(scene, linear, leaving, nodes, start)
        m, n = len(shapes), len(shapes.tension)
        modes = shapes.whole[inside].swapaxes(1, 2)
        out = np.zeros((m, m, m))
        out[:n, :n, :n] = shapes.tension
        out[:n, :n, :n] -= few.tension_by(modes[:, :, :n], modes[:, :, :n])
        few.destroy()
        return out


def _energy(shapes: Shapes, q: Array) -> float:
    """U(q) - U₀ of shapes [J]."""
    return float(ShapesOfBodies([shapes]).energy(q[None])[0])


def _moved(body: Body, d: Array, mean: Array, back: Array) -> BodyMotion:
    """The motion about another centre: that of the frozen shape is off by d [m].

    Shapes have means there, shape (m, 3), and coordinates turn back by T⁻¹.
    """
    before = body.motion
    arm, along = before.R @ (d + mean.T @ before.q), before.R @ (mean.T @ before.q_rate)
    velocity = before.velocity + np.cross(before.angular_velocity, arm) + along
    q, rate = back @ before.q, back @ before.q_rate
    return replace(before, r=before.r + arm, velocity=velocity, q=q, q_rate=rate)
