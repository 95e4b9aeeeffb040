"""Materials: parts that differ by many orders of magnitude, and near incompressibility."""

from __future__ import annotations

from collections.abc import Iterator

import rigidfx as rf

from .case import ANY, History, Run, between, case, near, release_at


def _two_halves(short: bool, stiff: rf.Material, soft: rf.Material, *effects: rf.Effect):
    """A bar of 8 m, the left half of one material, the right half of another."""
    domain = rf.box((0, 0, 0), (8, 2, 2), (4, 1, 1) if short else (8, 2, 2))
    domain = domain.with_cells("stiff", between(0, 4)).with_cells("soft", between(4, 8))
    return rf.Scene(domain, {"stiff": stiff, "soft": soft}, effects)


@case("material", "E differs by 1e8 and ρ by 1e6 between two halves")
def stiff_and_heavy_beside_soft_and_light(short: bool) -> Iterator[Run]:
    """H, L and J to Newton's tolerance, n 1e-12, and to rounding in the stiff half.

    u in double precision leaves forces of ε E₁/(ρ₂ v²) relative to those of the soft half, where
    that carries the motion: 1e-5 at worst, of which a step keeps the part that does work, 1e-10.
    Krylov iterations have to end by the residual of the system itself: by the preconditioned one
    momenta were off by 1e-2 in 200 steps.
    """
    soft = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=1.0)
    spin = rf.InitialVelocity(angular=(0.2, 0.3, 1.0))
    for way, rho in (("heavy is stiff", 1e6), ("heavy is soft", 1e-6)):
        stiff = rf.StVenantKirchhoff(E=1e12, nu=0.3, rho=rho)
        t_end = 2.0 if short else 20.0
        bound = t_end / 0.1 * (1e-10 if rho < 1 else 1e-12) + 1e-9
        options = {"energy": bound, "momentum": bound}
        scene = _two_halves(short, stiff, soft, spin)
        yield Run(f"{way}, flexible", scene, 0.1, t_end, **options)
        adaptive = rf.StrainRate(0.0, 0.5, tolerances={"stiff": ANY},
                                 release=release_at(1.5), patience=1)  # fmt: skip
        yield Run(f"{way}, adaptive", scene, 0.1, t_end, adaptive, **options)


@case("material", "E differs by 1e8, and the stiff half is rigid")
def stiff_half_as_a_body(short: bool) -> Iterator[Run]:
    """A body knows no stiffness: drifts and iterations as without the ratio."""
    soft = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
    spin = rf.InitialVelocity(angular=(0.2, 0.3, 1.0))
    for way, rho in (("equally heavy", 10.0), ("1e6 times as light", 1e-5)):
        stiff = rf.StVenantKirchhoff(E=1e12, nu=0.3, rho=rho)
        scene = _two_halves(short, stiff, soft, spin, rf.Rigid("stiff"))
        yield Run(f"{way}, named rigid", scene, 0.1, 2.0 if short else 20.0, tangents=5)


LENGTH, FORCE = 10.0, 10.0  # m, N


def _deflection(E: float, nu: float) -> float:
    """Tip deflection of a beam of 1 m × 1 m with bending and shear [m]."""
    shear = FORCE * LENGTH / (5 / 6 * E / (2 * (1 + nu)))
    return FORCE * LENGTH**3 / (3 * E / 12) + shear


@case("material", "ν = 0.4999: cells that cannot change their volume may hardly bend")
def nearly_incompressible(short: bool) -> Iterator[Run]:
    """H to Newton's tolerance; the deflection is that of a beam within 10 % (coarse cells).

    Cells of second order give it; those of first order lock, and a scene warns of them. Where the
    linear systems are too badly conditioned for Newton to end, steps are cut.
    """
    E, nu = 1e6, 0.4999

    def deflects(history: History) -> str:
        u = history.probe("tip")[0, 2]
        return near("locks: the static deflection", float(u), _deflection(E, nu), 0.1)

    for order, way, warns in ((2, "second order", ""), (1, "first order", "order=2")):

        def scene(order: int = order) -> rf.Scene:
            return rf.Scene(
                rf.box((0, 0, 0), (LENGTH, 1, 1), (10, 1, 1) if short else (20, 2, 2)),
                rf.StVenantKirchhoff(E=E, nu=nu, rho=1000.0),
                [rf.Fixed("x0"), rf.Preload([rf.NodalForce("x1", (0.0, 0.0, FORCE))])],
                order=order,
                probes={"tip": (LENGTH, 0.5, 0.5)},
            )

        yield Run(way, scene, 0.1, 1.0 if short else 10.0, momentum=None, check=deflects,
                  warns=warns, known="locks" if order == 1 else "",
                  why="first-order cells; take order=2", cuts=10)  # fmt: skip
