"""Units: convergence tests and guards must not know metres from millimetres."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import rigidfx as rf

from .case import ANY, History, Run, between, case, release_at

SYSTEMS = {  # one metre, one kilogram and one second in the units of each
    "SI": (1.0, 1.0, 1.0),
    "mm, t, s": (1e3, 1e-3, 1.0),
    "powers of two": (2.0**20, 2.0**-13, 2.0**5),
}


@case("units", "the same motion in mm, t and s, and in units 2²⁰, 2⁻¹³ and 2⁵ times those of SI")
def other_units(short: bool) -> Iterator[Run]:
    """Displacements and iterations are those in SI: to rounding, which steps magnify, 1e-10.

    Units that are powers of two change no digit: 1e-13.
    """
    t_end = 2.0 if short else 20.0
    for kind in ("flexible", "half rigid", "adaptive"):
        reference: list[History] = []
        for units, (length, mass, time) in SYSTEMS.items():
            domain = rf.box((0, 0, 0), np.array([8, 2, 2]) * length, (4, 1, 1))
            domain = domain.with_cells("left", between(0, 4 * length))
            pressure = mass / length / time**2
            effects = [
                rf.InitialVelocity(angular=(1.5 / time, 0.3 / time, 5.0 / time)),
                rf.Traction("x1", (0.0, 50.0 * pressure, 0.0), until=0.5 * time),
                *([rf.Rigid("left")] if kind == "half rigid" else []),
            ]
            scene = rf.Scene(
                domain,
                rf.StVenantKirchhoff(rho=mass / length**3, E=3e4 * pressure, nu=0.3),
                effects,
                probes={"tip": (8 * length, 2 * length, 2 * length)},
            )
            adaptive = rf.StrainRate(0.0, 0.5 * time, tolerances={"left": ANY / time},
                                     release=release_at(1.5 * time))  # fmt: skip

            def is_the_same(
                history: History,
                length: float = length,
                units: str = units,
                reference: list[History] = reference,
            ) -> str:
                reference.append(history)
                u, v = (h.probe("tip") for h in (reference[0], history))
                error = np.abs(v / length - u).max() / np.abs(u).max()
                extra = abs(sum(history.iterations) - sum(reference[0].iterations))
                bound = 1e-10 if units == "mm, t, s" else 1e-13
                if error > bound:
                    return f"the tip is off by {error:.1e}"
                most = max(2, sum(history.iterations) // 200)  # where rounding decides to stop
                return f"{extra} more or fewer iterations" if extra > most else ""

            yield Run(f"{kind}, {units}", scene, 0.05 * time, t_end * time,
                      adaptive if kind == "adaptive" else None, momentum=None,
                      check=is_the_same)  # fmt: skip
