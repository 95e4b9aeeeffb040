"""A trial step of all rigid bodies at once: their own residual and tangent, and how nodes follow.

See docs/theory.md, section 2: m (ṙ1 - ṙ0)/Δt and (π1 - π0)/Δt, times Δr and θ, are exactly the
increments of the kinetic energy. In the vector of unknowns θ is multiplied by the length ℓ,
ℓ² = tr J/(2 m), and moments are divided by it: all unknowns are lengths, all residuals forces.

`shaped_step` adds what the unknowns Δq of bodies with shapes change. All arrays begin with an axis
over the bodies; m is the largest number of shapes, n = 4 + 3 m.
"""

from functools import cached_property, partial
from itertools import accumulate
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.c_library import c_library
from rigidfx.base.types import Array, Ints
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rotation import IDENTITY, orthonormalized, skew

# f̂ v̂ = v fᵀ - (f·v) I from v fᵀ, both row by row.
COUPLES = np.eye(9) - np.outer(IDENTITY, IDENTITY)
SOURCES = [Path(__file__).with_name(f"{name}.c") for name in ("body_step", "shaped_step")]
# Data of a step of bodies with shapes for the C code; `Step.shaped` fills them in.
NUMBERS_OF_SHAPES = ("dt", "share", "rate")
ARRAYS_OF_SHAPES = (
    *("mass", "inertia", "length", "pose", "spin", "W0", "deformed"),
    *("q0", "rates0", "e0", "E0", "p0", "damping"),
    *("G", "couplings", "D", "stiffness", "force", "drift", "relieved", "shorter"),
    *("selves", "before"),
)
STRUCT = f"""
struct shaped {{
    int bodies, some, m, self;
    double {", ".join(NUMBERS_OF_SHAPES)};
    const int *at, *counts, *held;
    const double {", ".join("*" + name for name in ARRAYS_OF_SHAPES)};
}};
"""
DECLARED = f"""{STRUCT}
void trial(int, double, const double *, const double *, const double *, const double *,
           const double *, const double *, const double *, const double *, double *);
void resultant(int, const double *, const double *, const double *, double *);
void balance(int, const double *, const double *, const double *, const double *, double *);
void shaped_trial(const struct shaped *, const double *, const double *, double *, double *,
                  double *, double *, double *);
void shaped_resultant(const struct shaped *, const double *, double *, const double *, double *);
void shaped_blocks(const struct shaped *, const double *, const double *, double *, double *,
                   const double *, double *);
void shaped_follow(const struct shaped *, const double *, double *, int, double *);
"""
# Numbers of a body that a trial tells, all bodies' of one kind after those of the other.
KINDS: dict[str, tuple[int, ...]] = {
    "theta": (3,),
    "T": (3, 3),
    "R1": (3, 3),
    "R_av": (3, 3),
    "pi1": (3,),
    "displacement": (4, 3),
    "force": (6,),
}
ENDS = dict(zip(KINDS, accumulate(map(prod, KINDS.values())), strict=True))
PLACES = {name: (end - prod(KINDS[name]), end) for name, end in ENDS.items()}
ALL = ENDS["force"]
LENGTH = 2  # place of ℓ in what the C code is told of a step

_compiled: list[Any] = []  # the C code, once it is there


def prepare(comm: MPI.Intracomm) -> None:
    """Compile the C code before trials of bodies come, on rank 0. Collective.

    `CompilerError` is raised on every rank if the C compiler cannot be run, or fails.
    """
    if not comm.allreduce(len(_compiled) > 0, op=MPI.LAND):
        source = "\n".join(["#include <stddef.h>", STRUCT, *(path.read_text() for path in SOURCES)])
        _compiled[:] = [c_library(comm, "bodies", source, DECLARED, ["-O2", "-g0"])]


def _code() -> Any:
    if not _compiled:
        prepare(MPI.COMM_SELF)
    return _compiled[0]


class Step:
    """The constants of a step while it is solved.

    Attributes:
        start: The bodies at its start.
        dt: Δt [s].
        share: Derivative of the arms that moments are taken with, by those at the end.
        damping: Derivative of the damping forces of shapes by Δq, shape (bodies, m, m) [N/m].
        given: Increment Δc₀ and Cayley vector θ of the frames of bodies that are held, and Δq that
            supports give, shape (bodies, 6 + m) [m, 1]; they rest if None.
    """

    share = 0.5

    def __init__(
        self, start: Bodies, dt: float, damping: Array | None = None, given: Array | None = None
    ) -> None:
        """Prepare data of every trial; no shapes are damped if `damping` is None."""
        self.start, self.dt, self.damping, self.given = start, dt, damping, given

    @cached_property
    def code(self) -> tuple[Any, Any]:
        """The C code, and its view of arrays."""
        code = _code()
        return code.lib, partial(code.ffi.from_buffer, "double[]")

    @cached_property
    def _given(self) -> tuple[Any, ...]:
        """Data of the start for the C code."""
        of, start, (_, at) = self.start.of, self.start, self.code
        arrays = (of.mass, of.inertia, of.length, start.frame, start.velocity)
        return tuple(map(at, (*arrays, start.own_momentum, start.angular_momentum)))

    @cached_property
    def shaped(self) -> Any:
        """Data of bodies with shapes for the C code, and the arrays that they point to."""
        start, of, shapes = self.start, self.start.of, self.start.of.shapes
        assert shapes is not None
        doubles = (
            *(of.mass, of.inertia, of.length, start.frame, start.angular_momentum),
            *(start.angular_velocity_body, start.inertia, start.q, start.q_rate, start.stretched),
            *(start.weighted, start.momenta_of_shapes[1], self.damping, shapes.moments),
            *(shapes.couplings, shapes.mass, shapes.stiffness, shapes.force, shapes.drift),
            *(shapes.relieved, shapes.shorter, shapes.selves, shapes.before),
        )
        code = _code()
        sizes = len(of), shapes.some.size, shapes.most, shapes.before.shape[1]
        told = code.ffi.new("struct shaped *", sizes)
        told.dt, told.share, told.rate = self.dt, self.share, self.rate
        wholes = shapes.some, shapes.counts, shapes.held
        kept = [np.ascontiguousarray(numbers, dtype=np.intc) for numbers in wholes]
        told.at, told.counts, told.held = (code.ffi.from_buffer("int[]", one) for one in kept)
        for name, array in zip(ARRAYS_OF_SHAPES, doubles, strict=True):
            if array is not None:
                kept.append(np.ascontiguousarray(array, dtype=np.float64))
                setattr(told, name, code.ffi.from_buffer("double[]", kept[-1]))
        return told, kept

    def trial(self, six: Array) -> Array:
        """Results of a trial with Δr and ℓθ, one kind of `KINDS` after the other."""
        out = np.empty(ALL * len(six))
        if len(six):
            code, at = self.code
            code.trial(len(six), self.dt, *self._given, at(np.ascontiguousarray(six)), at(out))
        return out

    def collected(self, what: str, *arrays: Array) -> Array:
        """`Increments.resultant` or `balance` by the results of the trial, and by moments."""
        n = len(self.start)
        out = np.empty((n, 6))
        if n:
            code, at = self.code
            given = (at(np.ascontiguousarray(values)) for values in arrays)
            getattr(code, what)(n, self._given[LENGTH], *given, at(out))
        return out

    @property
    def rate(self) -> float:
        """Velocity at the end per increment, from rest [1/s]."""
        return 2 / self.dt

    @cached_property
    def inertia(self) -> Array:
        """2 J R0ᵀ/Δt², shape (bodies, 3, 3) [N m]."""
        return 2 / self.dt**2 * self.start.rotated_inertia

    @cached_property
    def block(self) -> Array:
        """The part of `Increments.tangent` that is the same in all trials."""
        out = np.zeros((len(self.start), 6, 6))
        out[:, :3, :3] = (2 / self.dt**2 * self.start.of.mass)[:, None, None] * IDENTITY
        return out


class StaticStep(Step):
    """A step of statics: arms of moments are those at its end, and there is no inertia."""

    share = 1.0

    def __init__(self, start: Bodies, given: Array | None = None) -> None:
        super().__init__(start, 1.0, None, given)

    def trial(self, six: Array) -> Array:
        """See `Step`."""
        told, n = super().trial(six), len(six)

        def part(name: str) -> Array:
            first, end = PLACES[name]
            return told[n * first : n * end]

        part("R_av")[:] = part("R1")
        part("pi1")[:] = part("force")[:] = 0.0
        return told

    @property
    def rate(self) -> float:
        """Nothing moves in time."""
        return 0.0

    @cached_property
    def inertia(self) -> Array:
        """There is none."""
        return np.zeros((len(self.start), 3, 3))

    @cached_property
    def block(self) -> Array:
        """There is none."""
        return np.zeros((len(self.start), 6, 6))


class Increments:
    """A trial step with the unknowns Δr, ℓθ and Δq, shape (bodies, 6 + m) [m]; `dr` is Δr."""

    def __init__(self, step: Step, unknowns: Array) -> None:
        """Try unknowns, from then on not to be changed."""
        self.step, self.unknowns = step, unknowns
        self.dr = unknowns[:, :3]
        self._told = step.trial(unknowns[:, :6])

    def __len__(self) -> int:
        return len(self.unknowns)

    @property
    def de(self) -> Array:
        """Change of the stretches of shapes, there are none, shape (bodies, 0) [m]."""
        return self.unknowns[:, 6:]

    @property
    def start(self) -> Bodies:
        """The bodies at the start of the step."""
        return self.step.start

    def _part(self, name: str) -> Array:
        n, (first, end) = len(self.unknowns), PLACES[name]
        return self._told[n * first : n * end].reshape(n, *KINDS[name])

    @property
    def theta(self) -> Array:
        """θ, shape (bodies, 3) [1]."""
        return self._part("theta")

    @property
    def T(self) -> Array:
        """Spin of R1 per unit dθ, shape (bodies, 3, 3)."""
        return self._part("T")

    @property
    def R1(self) -> Array:
        """Rotations at the end of the step, shape (bodies, 3, 3)."""
        return self._part("R1")

    @property
    def R_av(self) -> Array:
        """½ (R0 + R1), equation (4), shape (bodies, 3, 3)."""
        return self._part("R_av")

    @property
    def pi1(self) -> Array:
        """π1, angular momenta at the end about the centres, shape (bodies, 3) [kg m²/s]."""
        return self._part("pi1")

    @property
    def turned(self) -> Array:
        """Rotations that follower loads have: T R0 in a step, R1 in statics."""
        return self.R1 if self.step.share == 1.0 else self.T @ self.start.R

    @cached_property
    def end(self) -> Bodies:
        """The bodies at the end of the step."""
        pose = np.empty((len(self), 4, 3))
        pose[:, 0] = self.start.r + self.dr
        pose[:, 1:] = orthonormalized(self.R1).swapaxes(1, 2)
        rate = self.step.rate
        return Bodies(
            self.start.of,
            pose,
            rate * self.dr - self.start.velocity,
            rate * (self.theta[:, None] @ self.start.R)[:, 0] - self.start.angular_velocity_body,
        )

    def inertia_force(self) -> Array:
        """Evaluate m (ṙ1 - ṙ0)/Δt and (π1 - π0)/(ℓ Δt), shape (bodies, 6) [N]."""
        return self._part("force").copy()

    def blocks(self, moments: Array) -> Array:
        """`tangent` under forces with these moments, shape (bodies, 6 + m, 6 + m) [N/m]."""
        return self.tangent(self.couples(moments))

    def tangent(self, couples: Array) -> Array:
        """Derivative of the bodies' residual rows that P does not carry, (bodies, 6, 6) [N/m].

        Couples, shape (bodies, 3, 3) [N m], say how the moments Σ v_av × f change with R1.
        """
        rotation = (couples - skew(self.pi1 / self.step.dt)) @ self.T
        rotation += self.R1 @ self.step.inertia
        G = self.step.block.copy()
        np.divide(rotation, self.start.of.square_length, out=G[:, 3:, 3:])
        return G

    # Nodes of a body. With body-fixed coordinates a = [1, V, Φ₁ ... Φ_m], all that happens to them
    # goes through one matrix, shape (n, 3): displacements are a @ matrix, forces f enter as their
    # moments aᵀ f, with F = Σ f in the first row and A = Σ V fᵀ below. L and P say how its 3 n
    # numbers, row by row, depend on the body's unknowns.

    @property
    def displacement(self) -> Array:
        """The matrices of the displacements in this step, shape (bodies, n, 3) [m, 1]."""
        return self._part("displacement")

    @cached_property
    def L(self) -> Array:
        """Of the displacements Δr + θ × v_av, eqs. (5) and (13); shape (bodies, 12, 6) [1, 1/m]."""
        return self._followed(self._levers(self.R_av))

    @cached_property
    def P(self) -> Array:
        """Derivative of `displacement`: δr + T δθ × v₁; shape (bodies, 12, 6) [1, 1/m]."""
        return self._followed(self._levers(self.R1) @ self.T)

    def led(self, a: Array, of: Ints, end: bool = False) -> Array:
        """How places follow the unknowns of their bodies: L, or P at the end of the step.

        The body-fixed coordinates have the shape (k, places, n), their bodies the shape (k,), and
        the derivatives the shape (k, places, 3, 6 + m).
        """
        follow, columns = self.P if end else self.L, self.unknowns.shape[1]
        follow = follow[of].reshape(len(of), a.shape[2], 3 * columns)
        return np.asarray((a @ follow).reshape(*a.shape[:2], 3, columns))

    def _levers(self, R: Array) -> Array:
        """-v̂/ℓ of the columns v of matrices R, shape (bodies, 9, 3) [1/m]."""
        return (R.swapaxes(1, 2) @ self.start.of.skews).reshape(-1, 9, 3)

    def _followed(self, rotations: Array) -> Array:
        out = self.start.of.frames.copy()
        out[:, 3:, 3:] = rotations
        return out

    def resultant(self, moments: Array) -> Array:
        """Lᵀ: Σ f and Σ v_av × f/ℓ [N] of moments (bodies, 4, 3) [N, N m], shape (bodies, 6)."""
        return self.step.collected("resultant", self._told, moments)

    def balance(self, moments: Array, torques: Array) -> Array:
        """Residual of the bodies [N], shape (bodies, 6), by moments of all forces on their nodes.

        Moments leave out the bodies' own inertia; torques on bodies are (bodies, 3) [N m].
        """
        return self.step.collected("balance", self._told, moments, torques)

    def couples(self, moments: Array) -> Array:
        """Σ ½ f̂ᵢ v̂₁,ᵢ of forces with these moments, shape (bodies, 3, 3) [N m]: see `tangent`.

        In statics it is the whole Σ f̂ᵢ v̂₁,ᵢ.
        """
        B = self.R1 @ moments[:, 1:]  # Σ v₁ fᵀ
        return np.dot(B.reshape(-1, 9), self.step.share * COUPLES).reshape(-1, 3, 3)

    def work_of_supports(self, rows: Array) -> float:
        """Work of supports on frames by residuals of `balance` [J]: rigid bodies move freely."""
        return 0.0

    def work(self, forces: Array) -> float:
        """Work of forces and moments over ℓ, as `resultant` gives them, in the step [J]."""
        return float(np.vdot(forces, self.unknowns))
