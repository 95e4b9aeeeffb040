"""A warning where rounding in a stiff part is as large as the forces of a soft one."""

import warnings

import numpy as np
import parallel
import pytest
from histories import heard, show

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(E=1e3, nu=0.3, rho=1.0)


def tip(stiff, *supports):
    """Displacements of the end of a bar whose left half is stiff, or held."""
    domain = (
        rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
        .with_cells("hard", lambda X: X[0] <= 2 + 1e-9)
        .with_cells("soft", lambda X: X[0] >= 2 - 1e-9)
    )
    push = rf.Traction("x1", (1.0, 3.0, 0.0), until=0.3)
    materials = {"hard": stiff, "soft": SOFT}
    scene = rf.Scene(domain, materials, [*supports, push], probes={"tip": (4, 0.5, 0.5)})
    return np.array([r.probes["tip"] for r in rf.simulate(scene, 0.05, 0.6)])


def ratio(factor):
    return rf.StVenantKirchhoff(E=1e3 * factor, nu=0.3, rho=1.0)


@pytest.fixture(scope="module")
def exact():
    """That of a bar whose left half does not move at all."""
    return tip(SOFT, rf.Fixed("hard"))


def error(found, exact):
    return np.abs(found - exact).max() / np.abs(exact).max()


@pytest.mark.parametrize("factor", [1.0, 1e4, 1e8, 1e12, 1e14, 1e16])
def test_ratios_that_do_no_harm_pass(exact, factor):
    with warnings.catch_warnings():
        warnings.simplefilter("error", rf.RigidfxWarning)
        # A part that is 1e14 times as stiff has rounding that alternates, in some builds.
        warnings.filterwarnings("ignore", "(?s).*goes back and forth")
        found = tip(ratio(factor), rf.Fixed("x0"))
    show(off=error(found, exact))
    assert error(found, exact) <= 25 / factor + 1e-8


def floating(*effects, middle=SOFT, cells=(6, 1, 1)):
    """Displacements of the end of a bar whose middle third is of another material, or rigid."""
    domain = (
        rf.box((0, 0, 0), (6, 1, 1), cells)
        .with_cells("first", lambda X: X[0] <= 2 + 1e-9)
        .with_cells("middle", lambda X: (X[0] >= 2 - 1e-9) & (X[0] <= 4 + 1e-9))
        .with_cells("last", lambda X: X[0] >= 4 - 1e-9)
    )
    push = rf.Traction("x1", (1.0, 3.0, 0.0), until=0.3)
    materials = {"first": SOFT, "middle": middle, "last": SOFT}
    supports = [rf.Fixed("x0"), push, *effects]
    scene = rf.Scene(domain, materials, supports, probes={"tip": (6, 0.5, 0.5)})
    return np.array([r.probes["tip"] for r in rf.simulate(scene, 0.05, 0.6)])


@pytest.mark.filterwarnings("ignore:.*balance of energy is off")
@pytest.mark.parametrize("cells", [(6, 1, 1), (12, 2, 2)])
def test_a_soft_part_that_is_off_is_warned_of_once(cells):
    with pytest.warns(rf.RigidfxWarning, match="before softer ones were in balance") as shown:
        found = floating(middle=ratio(1e15), cells=cells)
    assert sum("softer" in str(w.message) for w in shown) == 1
    off = error(found, floating(rf.Rigid("middle"), cells=cells))
    show(off=off)
    assert off > 1e-6


@pytest.mark.parametrize("cells", [(6, 1, 1), (12, 2, 2)])
def test_a_stiff_part_that_floats_is_warned_of(cells):
    """Of its motion as a whole neither the residual nor its own stiffness tells."""
    with pytest.warns(rf.RigidfxWarning, match="before softer ones were in balance"):
        found = floating(middle=ratio(1e12), cells=cells)
    off = error(found, floating(rf.Rigid("middle"), cells=cells))
    show(off=off)
    assert off <= 1e-6


@pytest.mark.parallel
def test_a_stiff_part_that_floats_over_ranks_is_warned_of():
    (said,) = parallel.run(__file__, 2, timeout=120)
    assert "before softer ones were in balance" in said


def test_a_stiff_part_that_floats_and_does_no_harm_passes():
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "In the step from", rf.RigidfxWarning)
        found = floating(middle=ratio(1e8))
    assert error(found, floating(rf.Rigid("middle"))) <= 1e-6


def test_a_stiff_free_body_passes():
    """Its flight needs no forces: all that is left is rounding, and does no harm."""
    start = rf.InitialVelocity(linear=(0.1, 0, 0), angular=(0.1, 0.2, 0.5))
    steel = rf.StVenantKirchhoff(E=2.1e11, nu=0.3, rho=7850.0)
    scene = rf.Scene(rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)), steel, [start])
    with warnings.catch_warnings():
        warnings.simplefilter("error", rf.RigidfxWarning)
        list(rf.simulate(scene, 0.05, 1.0))


def test_rest_passes():
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), ratio(1e8), [rf.Gravity((0, 0, 0))])
    with warnings.catch_warnings():
        warnings.simplefilter("error", rf.RigidfxWarning)
        warnings.filterwarnings("ignore", ".* nothing acts")
        list(rf.simulate(scene, 0.05, 0.2))


if __name__ == "__main__":
    with heard("In the step") as found:
        floating(middle=ratio(1e13), cells=(12, 2, 2))
    parallel.report(found)
