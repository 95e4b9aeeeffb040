"""Finite rotations: the Cayley map is a rotation, and its tangent is its derivative."""

import numpy as np
from histories import EPS
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rigidfx.mechanics.rotation import axial, cayley, cross, orthonormalized, skew

# |θ| up to 8: angles up to 2.65 rad in one step.
coordinate = st.floats(-4.5, 4.5)
vectors = st.tuples(coordinate, coordinate, coordinate).map(np.array)


def angle_vector(theta):
    """The same rotation as SciPy describes it: 2 atan(|θ|/2) about θ."""
    size = np.linalg.norm(theta)
    return 2 * np.arctan(size / 2) * theta / size if size else theta


@given(a=vectors, b=vectors)
def test_skew_is_the_cross_product(a, b):
    """Of one vector, of many, and of complex ones."""
    assert np.allclose(skew(a) @ b, np.cross(a, b), rtol=0, atol=100 * EPS)
    many = skew(np.array([a, b]))
    assert many.shape == (2, 3, 3)
    assert np.array_equal(many[1], skew(b))
    assert np.array_equal(skew(1j * a), 1j * skew(a))
    assert np.array_equal(cross(a, many), np.cross(a, many))
    moments = axial(np.array([np.outer(a, b), np.outer(b, a)]))
    assert np.array_equal(moments, [np.cross(a, b), np.cross(b, a)])


@given(theta=vectors)
def test_cayley_is_the_rotation_it_says(theta):
    """Orthonormal to rounding, by 2 atan(|θ|/2) about θ, and (I - ½θ̂)⁻¹ (I + ½θ̂)."""
    R = cayley(theta)
    assert np.abs(R.T @ R - np.eye(3)).max() <= 20 * EPS
    assert abs(np.linalg.det(R) - 1) <= 20 * EPS
    assert np.abs(R - Rotation.from_rotvec(angle_vector(theta)).as_matrix()).max() <= 50 * EPS
    quotient = np.linalg.solve(np.eye(3) - skew(theta) / 2, np.eye(3) + skew(theta) / 2)
    assert np.abs(R - quotient).max() <= 200 * EPS
    assert np.abs(cayley(-theta) - R.T).max() <= 20 * EPS


@given(theta=vectors, V=vectors)
def test_displacement_is_exact_in_the_averaged_position(theta, V):
    """R V - V = θ × ½(V + R V), equation (4): why this parametrisation is used."""
    v1 = cayley(theta) @ V
    assert np.abs(v1 - V - np.cross(theta, (V + v1) / 2)).max() <= 500 * EPS


@given(theta=vectors, noise=vectors, more=vectors)
def test_orthonormalized_mends_rounding_and_nothing_else(theta, noise, more):
    """An error of size δ is left at 2 δ²; a rotation stays what it is."""
    R = cayley(theta)
    assert np.abs(orthonormalized(R) - R).max() <= 20 * EPS
    delta = 1e-7
    wrong = R + delta * np.outer(noise, more) / 20
    mended = orthonormalized(wrong)
    assert np.abs(mended.T @ mended - np.eye(3)).max() <= 10 * delta**2 + 20 * EPS


def test_products_of_rotations_stay_orthonormal():
    """10⁴ increments of a step of a body."""
    R, step = np.eye(3), cayley(np.array([0.3, -0.7, 0.2]))
    for _ in range(10_000):
        R = orthonormalized(step @ R)
    assert np.abs(R.T @ R - np.eye(3)).max() <= 20 * EPS
