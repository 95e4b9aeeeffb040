"""The balances of a run, by forces computed here: no code of a step is used."""

from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem, la

import rigidfx as rf
from rigidfx.base import compat

__all__ = ["Books", "follow"]


@dataclass
class Books:
    """How far a run was from its balances, relative; the largest of all steps.

    Attributes:
        energy: Of ΔH = work of loads + work of reactions - dissipation, relative to the largest H;
            here and below what an impact on a support did is counted with the reactions.
        linear: Of ΔL = Δt (Σ f + reactions), relative to Σ m|v|.
        angular: Of ΔJ = Δt (Σ x½ × f + moments of reactions), relative to Σ m|v| times the size.
        work: Of the reported work of the loads, relative to the largest H.
        dissipation: Of the reported dissipation by kind, relative to the largest H.
        lost: Energy dissipated in all [J].
        iterations: Most Newton iterations of a step.
    """

    energy: float = 0.0
    linear: float = 0.0
    angular: float = 0.0
    work: float = 0.0
    dissipation: float = 0.0
    lost: float = 0.0
    iterations: int = 0

    @property
    def worst(self) -> float:
        """The largest of all."""
        return max(self.energy, self.linear, self.angular, self.work, self.dissipation)


class Forces:
    """Nodal forces of a scene's effects in a step, over all cells, frozen or not."""

    def __init__(self, scene):
        self.scene = scene
        self.u0, self.u1, self.v0 = (fem.Function(scene.space) for _ in range(3))
        self.n = scene.owned_nodes
        mesh, w = scene.mesh, ufl.TestFunction(scene.space)
        half = (self.u0 + self.u1) / 2
        F = ufl.Identity(3) + ufl.grad(half)
        area = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(mesh)
        self.pressures = []
        for effect in scene.named(rf.Pressure):
            facets = scene.domain.find(effect.where, (2,), "").entities
            pairs = compat.integration_facets(mesh, facets)
            ds = ufl.Measure("ds", mesh, subdomain_data=[(1, pairs)])
            form = fem.form(ufl.inner(area, w) * ds(1, metadata={"quadrature_degree": 9}))
            self.pressures.append((effect, form))
        dE = (lambda G1, G0: (G1.T * G1 - G0.T * G0) / 2)(
            ufl.Identity(3) + ufl.grad(self.u1), ufl.Identity(3) + ufl.grad(self.u0)
        )
        self.viscous = []
        for effect in scene.named(rf.KelvinVoigt):
            cells = scene.owned_cells(effect.where, "")
            dx = ufl.Measure("dx", mesh, subdomain_data=[(1, cells)])
            degree = {"quadrature_degree": scene.quadrature_degree}
            form = fem.form(effect.eta * ufl.inner(dE, dE) * dx(1, metadata=degree))
            self.viscous.append((effect, form))
        dead = {rf.Gravity: scene.density(), rf.BodyForce: 1.0}
        self.dead = []
        for effect in scene.named(rf.Gravity) + scene.named(rf.BodyForce):
            q = dead[type(effect)] * ufl.as_vector(effect.value)
            degree = {"quadrature_degree": 2 * scene.order + 2}
            f = fem.assemble_vector(fem.form(ufl.inner(q, w) * ufl.dx(metadata=degree)))
            f.scatter_reverse(la.InsertMode.add)
            nodal = f.array.reshape(-1, 3)[: self.n].copy()
            if isinstance(effect, rf.Gravity):
                nodal += scene.point_masses[: self.n, None] * np.asarray(effect.value)
            self.dead.append((effect, nodal))
        for effect in scene.named(rf.Traction):
            facets = scene.domain.find(effect.where, (2,), "").entities
            pairs = compat.integration_facets(mesh, facets)
            ds = ufl.Measure("ds", mesh, subdomain_data=[(1, pairs)])
            f = fem.assemble_vector(fem.form(ufl.inner(ufl.as_vector(effect.value), w) * ds(1)))
            f.scatter_reverse(la.InsertMode.add)
            self.dead.append((effect, f.array.reshape(-1, 3)[: self.n].copy()))
        for effect in scene.named(rf.NodalForce):
            nodes = scene.nodes(effect.where, "")
            own = nodes[nodes < self.n]
            f = np.zeros((self.n, 3))
            f[own] = np.asarray(effect.value) / scene.sum(own.size)
            self.dead.append((effect, f))
        trial = ufl.TrialFunction(scene.space)
        if scene.mass == "consistent":
            degree = {"quadrature_degree": 2 * scene.order + 2}
            self.mass = ufl.inner(scene.density() * trial, w) * ufl.dx(metadata=degree)

    def momenta(self, v):
        """M v of all nodes for values v at local nodes."""
        if self.scene.mass == "lumped":
            return (self.scene.nodal_mass[:, None] * v)[: self.n]
        field = fem.Function(self.scene.space)
        field.x.array[:] = v.reshape(-1)
        f = fem.assemble_vector(fem.form(ufl.action(self.mass, field)))
        f.scatter_reverse(la.InsertMode.add)
        return (f.array.reshape(-1, 3) + self.scene.point_masses[:, None] * v)[: self.n]

    def of_step(self, t, dt):
        """Loads, resistances of springs and drag, each (nodes, 3), and energies lost by kind."""
        n, scene = self.n, self.scene
        u0, u1 = (f.x.array.reshape(-1, 3) for f in (self.u0, self.u1))
        du, middle = u1 - u0, (0.5 * (u0 + u1))[:n]
        loads, ground = np.zeros((n, 3)), np.zeros((n, 3))
        lost = {}
        for effect, form in self.pressures:
            f = fem.assemble_vector(form)
            f.scatter_reverse(la.InsertMode.add)
            loads -= effect.intensity(t) * f.array.reshape(-1, 3)[:n]
        for effect, nodal in self.dead:
            factor = effect.time(t) if effect.time else 1.0
            loads += nodal * factor * (effect.since <= t <= effect.until)
        for effect in scene.named(rf.Spring):
            w = scene.shares(effect.where, "")[:n, None]
            ground -= w * (middle @ effect.K + du[:n] @ effect.C / dt)
            lost["Spring"] = lost.get("Spring", 0.0) + np.vdot(w * du[:n], du[:n] @ effect.C) / dt
        for effect in scene.named(rf.MassDamping):
            if effect.acts(t):
                drag = effect.alpha * self.momenta(du) / dt
                ground -= drag
                lost["MassDamping"] = lost.get("MassDamping", 0.0) + np.vdot(drag, du[:n])
        for effect, form in self.viscous:
            if effect.acts(t):
                own = fem.assemble_scalar(form) / dt
                lost["KelvinVoigt"] = lost.get("KelvinVoigt", 0.0) + own
        return loads, ground, lost


def of_resultant(load, before, after):
    """Force, moment about the origin and work of a `Resultant` in a step."""
    t = after.t - after.dt / 2
    (a,), (b,) = ([x for x in r.bodies if x.name == load.body] for r in (before, after))
    turn = b.orientation @ a.orientation.T
    # Cayley vector: (R - I) (R + I)⁻¹ = ½ θ̂
    half = (turn - np.eye(3)) @ np.linalg.inv(turn + np.eye(3))
    theta = 2 * np.array([half[2, 1], half[0, 2], half[1, 0]])
    force, torque = load.both_at(t)
    moment = np.cross((a.centre + b.centre) / 2, force) + torque
    return force, moment, force @ (b.centre - a.centre) + torque @ theta


def follow(scene, dt, t_end, **options):
    """Run a scene with loads on elements, springs and damping, and keep its books."""
    forces, books, previous = Forces(scene), Books(), None
    n = scene.owned_nodes
    X = scene.space.tabulate_dof_coordinates()[:n]
    size = scene.comm.allreduce(float(np.abs(X).max(initial=0.0)))
    reports = []
    for report in rf.simulate(scene, dt, t_end, **options):
        report.state.rebuild()
        forces.u1.x.array[:] = report.state.u.x.array
        reports.append(report)
        books.iterations = max(books.iterations, report.iterations)
        if previous is not None:
            loads, ground, lost = forces.of_step(report.t - report.dt / 2, report.dt)
            u0, u1 = (f.x.array.reshape(-1, 3)[:n] for f in (forces.u0, forces.u1))
            x = X + 0.5 * (u0 + u1)
            f = loads + ground
            work, total, moment = (
                scene.sum(np.vdot(loads, u1 - u0)),
                f.sum(0),
                np.cross(x, f).sum(0),
            )
            total = scene.sum(total) + sum(report.reactions.values(), np.zeros(3))
            moment = scene.sum(moment) + sum(report.reaction_moments.values(), np.zeros(3))
            found = {kind: scene.sum(value) for kind, value in lost.items()}
            numerical = report.dissipated.get("NumericalDamping", 0.0)
            dissipated = sum(found.values()) + numerical
            H = max(r.kinetic + r.strain + r.stored + r.springs for r in reports)
            scale = max(r.momentum_scale for r in reports)
            for load in scene.named(rf.Resultant):
                force, turn_force, moved = of_resultant(load, previous, report)
                total, moment, work = total + force, moment + turn_force, work + moved
            hit = report.impact
            energy = work + report.work_of_supports - dissipated + (hit.energy if hit else 0.0)
            besides = report.alternating_impulse
            push = report.dt * total + besides[0] + (hit.impulse if hit else 0.0)
            turn = report.dt * moment + besides[1] + (hit.angular_impulse if hit else 0.0)
            gap = {
                "energy": abs(report.energy - previous.energy - energy) / H,
                "linear": np.abs(report.linear_momentum - previous.linear_momentum - push).max()
                / scale,
                "angular": np.abs(report.angular_momentum - previous.angular_momentum - turn).max()
                / (scale * size),
                "work": abs(report.work_of_loads - work) / H,
                "dissipation": max(
                    (abs(found[k] - report.dissipated.get(k, 0.0)) for k in found), default=0.0
                )
                / H,
            }
            for name, value in gap.items():
                setattr(books, name, max(getattr(books, name), float(value)))
            books.lost += dissipated
        forces.u0.x.array[:] = report.state.u.x.array
        previous = report
    return books, reports
