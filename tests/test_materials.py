"""Stresses of the materials, the discrete gradient and its tangent."""

from functools import cache

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from histories import EPS, column, drift, show
from hypothesis import given, settings
from hypothesis import strategies as st

import rigidfx as rf
from rigidfx.base.errors import SceneError
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.kernels import jit_options
from rigidfx.mechanics import schemes as forms
from rigidfx.mechanics.schemes import rest_moduli

MATERIALS = {
    "StVenantKirchhoff": rf.StVenantKirchhoff(rho=10.0, E=2.0, nu=0.3),
    "NeoHooke": rf.NeoHooke(rho=10.0, E=2.0, nu=0.45),
    "MooneyRivlin": rf.MooneyRivlin(rho=10.0, c10=0.3, c01=0.1, kappa=2.0),
}


# At points: compiled expressions of tensors, one random state per cell ---------------------------


class AtPoints:
    """Energies and stresses of a material at many pairs of tensors at once."""

    def __init__(self, material):
        mesh = rf.box((0, 0, 0), (1, 1, 1), (10, 10, 10)).mesh
        self.cells = np.arange(1000, dtype=np.int32)
        space = fem.functionspace(mesh, ("DG", 0, (3, 3)))
        self._mesh, self._C0, self._C1 = mesh, fem.Function(space), fem.Function(space)
        C0, C1 = ufl.variable(self._C0), self._C1
        # Parameters as the package has them: numbers that the compiler does not know.
        p = {n: fem.Constant(mesh, float(v)) for n, v in material.parameters.items()}
        W0, W1 = material.energy(self._C0, **p), material.energy(C1, **p)
        tensors = [
            forms.second_piola_kirchhoff(material.energy, self._C0, p),
            forms.second_piola_kirchhoff(material.energy, C1, p),
            forms.discrete_gradient(material.energy, p, C0, C1),
            forms.initial_stiffness_times(material.energy, p, (C1 - self._C0) / 2),
        ]
        parts = [W0, W1, *(T[i, j] for T in tensors for i in range(3) for j in range(3))]
        self._expression = fem.Expression(
            ufl.as_vector(parts), np.full((1, 3), 0.5), jit_options=jit_options()
        )

    def __call__(self, C0, C1):
        """W₀, W₁, S₀, S₁, discrete gradient, ℂ₀:(E₁ - E₀)."""
        self._C0.x.array[:], self._C1.x.array[:] = C0.ravel(), C1.ravel()
        out = self._expression.eval(self._mesh, self.cells).reshape(len(self.cells), -1)
        return out[:, 0], out[:, 1], *(out[:, 2:].reshape(-1, 4, 3, 3).transpose(1, 0, 2, 3))


@cache
def at_points(name):
    return AtPoints(MATERIALS[name])


def _symmetric(rng, size):
    M = rng.normal(size=(1000, 3, 3))
    M = M + M.transpose(0, 2, 1)
    return np.reshape(size, (-1, 1, 1)) * M / np.linalg.norm(M, axis=(1, 2))[:, None, None]


def _states(rng, strain):
    """Random right Cauchy-Green tensors."""
    F = np.eye(3) + strain * rng.uniform(-1, 1, size=(1000, 3, 3))
    return F.transpose(0, 2, 1) @ F


def _dot(A, B):
    return np.einsum("nij,nij->n", A, B)


SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("name", MATERIALS)
def test_reference_state_is_free_of_stress_and_energy(name):
    """W = 0 and S = 0 at C = I."""
    eye = np.tile(np.eye(3), (1000, 1, 1))
    W0, _, S0, _, S_dg, C_dE = at_points(name)(eye, eye)
    for value in (W0, S0, S_dg, C_dE):
        assert np.abs(value).max() <= 10 * EPS


@pytest.mark.parametrize("name", MATERIALS)
def test_small_strain_moduli(name):
    """ℂ₀:ΔE is λ tr(ΔE) I + 2 μ ΔE of linear elasticity, and the slope of S at C = I."""
    material = MATERIALS[name]
    if name == "MooneyRivlin":
        mu = 2 * (material.c10 + material.c01)
        lmbda = material.kappa - 2 * mu / 3
    else:
        lmbda, mu = (material.parameters[n] for n in ("lmbda", "mu"))
        E = mu * (3 * lmbda + 2 * mu) / (lmbda + mu)
        assert pytest.approx(material.E, rel=10 * EPS) == E
        assert lmbda / (2 * (lmbda + mu)) == pytest.approx(material.nu, rel=10 * EPS)
    h, eye = 1e-5, np.eye(3)
    dE = _symmetric(np.random.default_rng(1), 1.0)
    trace = np.trace(dE, axis1=1, axis2=2)[:, None, None]
    hooke = lmbda * trace * eye + 2 * mu * dE
    _, _, S0, S1, _, C_dE = at_points(name)(eye - 2 * h * dE, eye + 2 * h * dE)
    # C1 - C0 itself carries the rounding of C.
    assert np.abs(C_dE / (2 * h) - hooke).max() <= 20 * EPS / h
    # Central difference: error h² of truncation, eps/h of rounding.
    assert np.abs((S1 - S0) / (2 * h) - hooke).max() <= 100 * h**2 + 20 * EPS / h


@settings(max_examples=5)
@given(seed=SEEDS)
@pytest.mark.parametrize("name", MATERIALS)
def test_stress_is_the_derivative_of_the_energy(name, seed):
    """S:M = 2 dW/ds at C + s M, by a fourth-order difference."""
    rng, h = np.random.default_rng(seed), 1e-3
    C, M = _states(rng, 0.2), _symmetric(rng, 1.0)
    near0, near1, S, *_ = at_points(name)(C - h * M, C + h * M)
    far0, far1, *_ = at_points(name)(C - 2 * h * M, C + 2 * h * M)
    S = at_points(name)(C, C)[2]
    slope = 2 * (far0 - 8 * near0 + 8 * near1 - far1) / (12 * h)
    # Truncation h⁴ W⁽⁵⁾/15: at 20 % strain C has eigenvalues down to 0.3, and the fifth
    # derivative of their logarithm is 24/0.3⁵ = 1e4.
    assert np.abs(_dot(S, M) - slope).max() <= 1e4 * h**4 + 20 * EPS / h


@settings(max_examples=10)
@given(seed=SEEDS, strain=st.sampled_from([0.0, 1e-6, 1e-3, 0.2]))
@pytest.mark.parametrize("name", MATERIALS)
def test_discrete_gradient_yields_the_energy_difference(name, seed, strain):
    """S:(C₁ - C₀) = 2 (W₁ - W₀) to rounding, from |C₁ - C₀| = 1e-12 on, across the guard."""
    rng = np.random.default_rng(seed)
    size = 10 ** rng.uniform(-12, -1, 1000)
    C0 = _states(rng, strain)
    C1 = C0 + _symmetric(rng, size)
    M = C1 - C0
    W0, W1, _, _, S, _ = at_points(name)(C0, C1)
    assert np.isfinite(S).all()
    # The energies are sums of terms of the size of the moduli (some 1, and more where J is small).
    assert np.abs(_dot(S, M) - 2 * (W1 - W0)).max() <= 100 * EPS
    # The correction must not disturb the stress, mean of S at two Gauss points: it stays within
    # |M|⁴ times a fifth derivative of W, and rounding, which it divides by |M| where it acts.
    points = [C0 + s * M for s in (0.5 - 12**-0.5, 0.5 + 12**-0.5)]
    _, _, Sa, Sb, *_ = at_points(name)(*points)
    disturbance = np.abs(S - (Sa + Sb) / 2).max(axis=(1, 2))
    allowed = 1e3 * size**4 + 100 * EPS / np.where(size > 9e-4, size, 1.0)
    assert (disturbance / allowed).max() <= 1


# On a mesh: assembled vectors and tangents ------------------------------------------------------


class Assembled:
    """Internal forces of a small scene and their tangent at random displacements."""

    def __init__(self, material, *effects):
        domain = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1))
        self.scene = rf.Scene(domain, material, effects)
        self.u0 = fem.Function(self.scene.space)
        self.forces = InternalForces(self.scene, self.u0, [self.scene.acting(0.0)])
        self.bound = self.forces.bind(self.forces.cells())

    def at(self, u0, u1):
        self.u0.x.array[:], self.forces.u1.x.array[:] = u0, u1
        self.forces.set_time(0.0, 1.0)
        return self

    @property
    def residual(self):
        out = np.zeros_like(self.u0.x.array)
        fem.assemble_vector(out, self.bound.residual)
        return out

    def tangent_times(self, w):
        K = fem_petsc.assemble_matrix(self.bound.interior)
        K.assemble()
        x, y = K.createVecRight(), K.createVecLeft()
        x.array[:] = w
        K.mult(x, y)
        out = y.array_r.copy()
        for item in (K, x, y):
            item.destroy()
        return out

    def random(self, seed, size):
        return size * np.random.default_rng(seed).uniform(-1, 1, self.u0.x.array.size)


@pytest.mark.parametrize("seed", range(3))
def test_assembled_discrete_gradient_is_the_averaged_stress(seed):
    """The two ways to St.Venant-Kirchhoff's force vector agree to rounding."""
    material = MATERIALS["StVenantKirchhoff"]
    general = rf.Hyperelastic(rho=10.0, W=material.energy, values=dict(material.parameters))
    assert not general.quadratic
    found = []
    for m in (material, general):
        a = Assembled(m)
        found.append(a.at(a.random(seed, 0.1), a.random(seed + 10, 0.1)).residual)
    assert np.abs(found[0] - found[1]).max() <= 100 * EPS * np.abs(found[0]).max()


@pytest.mark.parametrize("xi", [None, 0.3])
@pytest.mark.parametrize("name", MATERIALS)
def test_tangent_is_the_derivative_of_the_residual(name, xi):
    """K w against a fourth-order difference of the residual, away from and inside the guard."""
    damping = [] if xi is None else [rf.NumericalDamping(xi)]
    a = Assembled(MATERIALS[name], *damping)
    u0, w, h = a.random(1, 0.05), a.random(2, 1.0), 1e-3
    for step in (a.random(3, 0.05), a.random(3, 1e-6)):
        u1 = u0 + step
        r = [a.at(u0, u1 + k * h * w).residual for k in (-2, -1, 1, 2)]
        slope = (r[0] - 8 * r[1] + 8 * r[2] - r[3]) / (12 * h)
        K_w = a.at(u0, u1).tangent_times(w)
        error = np.abs(K_w - slope).max() / np.abs(slope).max()
        show(error=error)
        # The guard leaves out a term of |M|⁴ of the stress: |M|³ = 1e-9 of the tangent, at most.
        assert error <= 1e3 * h**4 + EPS / h + 1e-8


@pytest.mark.parametrize("xi", [None, 0.3])
@pytest.mark.parametrize("name", MATERIALS)
def test_tangent_is_finite_and_symmetric_where_nothing_moves(name, xi):
    """At u₁ = u₀ = 0 no quotient becomes 0/0, and K is ½ (or ½ + ξ) the symmetric stiffness."""
    damping = [] if xi is None else [rf.NumericalDamping(xi)]
    a = Assembled(MATERIALS[name], *damping)
    zero = np.zeros_like(a.u0.x.array)
    assert np.abs(a.at(zero, zero).residual).max() <= 10 * EPS
    v, w = a.random(1, 1.0), a.random(2, 1.0)
    K_v, K_w = a.tangent_times(v), a.tangent_times(w)
    assert np.isfinite(K_v).all()
    assert v @ K_v > 0
    assert abs(w @ K_v - v @ K_w) <= 100 * EPS * abs(v @ K_v)
    deformed = a.random(3, 0.1)
    assert np.isfinite(a.at(deformed, deformed).tangent_times(v)).all()
    if xi is not None:
        undamped = Assembled(MATERIALS[name]).at(zero, zero).tangent_times(v)
        assert np.abs(K_v - (1 + 2 * xi) * undamped).max() <= 100 * EPS * np.abs(K_v).max()


def test_moduli_at_rest():
    """Of formulas; of an energy with a direction those of its mean over all directions."""

    def fibres(C, mu, k):
        return (
            mu * ufl.inner(C - ufl.Identity(3), C - ufl.Identity(3)) / 4
            + k * (C[0, 0] - 1) ** 2 / 8
        )

    assert rest_moduli(rf.NeoHooke(E=1e4, nu=0.3, rho=10.0)) == pytest.approx(
        (1e4 * 0.3 / 1.3 / 0.4, 1e4 / 2.6)
    )
    stiff = rf.MooneyRivlin(c10=1.0, c01=2.0, kappa=30.0, rho=1.0)
    assert rest_moduli(stiff) == pytest.approx((26.0, 6.0))
    lam, mu = rest_moduli(rf.Hyperelastic(rho=1.0, W=fibres, values={"mu": 2.0, "k": 15.0}))
    assert (lam, mu) == pytest.approx((1.0, 3.0))  # k/15 each beside μ


# Materials in a scene ---------------------------------------------------------------------------


def _halves(effects, left, right):
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    domain = domain.with_cells("left", lambda x: x[0] < 2 + 1e-9)
    domain = domain.with_cells("right", lambda x: x[0] > 2 - 1e-9)
    material = left if right is None else {"left": left, "right": right}
    scene = rf.Scene(domain, material, effects, probes={"tip": (4.0, 1.0, 1.0)})
    return list(rf.simulate(scene, 0.1, 3.0))


SPIN = rf.InitialVelocity(angular=(0.0, 0.05, 0.1), function=lambda X: 0.05 * np.sin(X[[1, 2, 0]]))


@pytest.mark.parametrize("name", ["StVenantKirchhoff", "NeoHooke"])
def test_parameters_by_cell_are_those_by_constant(name):
    """Cell-wise coefficients and constants of the same values give the same history."""
    kind = getattr(rf, name)
    soft, stiff = kind(rho=1.0, E=2.0, nu=0.3), kind(rho=3.0, E=6.0, nu=0.3)

    # The same energy by another function: two kernels with constants, not one with coefficients.
    def energy(C, **p):
        return kind(rho=1.0, E=1.0, nu=0.0).energy(C, **p)

    other = rf.Hyperelastic(rho=3.0, W=energy, values=dict(stiff.parameters))
    by_cell = _halves([SPIN], soft, stiff)
    by_constant = _halves([SPIN], soft, other)
    for what in ("energy", "strain"):
        a, b = column(by_cell, what), column(by_constant, what)
        # 30 steps to Newton's 1e-12 each.
        assert np.abs(a - b).max() <= 30 * 1e-12 * a.max()
    assert drift(column(by_cell, "energy")) <= 30 * 1e-12
    tips = [r[-1].probes["tip"] for r in (by_cell, by_constant)]
    assert np.abs(tips[0] - tips[1]).max() <= 30 * 1e-11


def test_equal_materials_by_tag_are_one_material():
    """Naming both halves with the same material changes nothing."""
    material = rf.NeoHooke(rho=2.0, E=3.0, nu=0.3)
    one, two = _halves([SPIN], material, None), _halves([SPIN], material, material)
    assert np.array_equal(column(one, "energy"), column(two, "energy"))


def test_own_energy_that_a_function_on_the_mesh_is_in():
    """The same motion as by its number; enhanced cells cannot tell their modes, and say so."""
    bar, spin = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), rf.InitialVelocity(angular=(0, 3.0, 0))
    stiffness = fem.Function(fem.functionspace(bar.mesh, ("DG", 0)))
    stiffness.x.array[:] = 1e3

    def turning(k, **options):
        def energy(C):
            E = (C - ufl.Identity(3)) / 2
            return k / 2 * ufl.inner(E, E)

        scene = rf.Scene(bar, rf.Hyperelastic(W=energy, rho=1.0), [spin], **options)
        return [r.energy for r in rf.simulate(scene, 0.02, 0.1, progress=False)]

    assert np.allclose(turning(stiffness), turning(1e3), rtol=1e-13)
    with pytest.raises(SceneError, match="its energy depends on the place"):
        turning(stiffness, element="enhanced")
