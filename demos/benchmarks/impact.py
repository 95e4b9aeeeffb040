"""Impacts with known answers: waves in a bar, bounces, Hertz, friction, and energy through it all.

    ./fenicsx python3 demos/benchmarks/impact.py
    ./fenicsx python3 demos/benchmarks/impact.py --short --only wall

`summary.json` has, of the bar that hits a wall, `energy_drift`, `force_error`, `duration_error` and
`rebound_error`, relative to the theory of plane waves in one dimension (force ρ c v S for 2 L/c,
rebound at v; lateral motion is blocked), and the numbers of each case in `cases`.
"""

from collections.abc import Callable

from bench import Parser, chosen, conclude
from bench.impacts import (
    bar_against_wall,
    bars,
    bounces,
    energy_in_contact,
    energy_of_pairs,
    friction,
    hertz,
    share_of_search,
)

parser = Parser(__file__, __doc__.splitlines()[0], "fewer cells, steps and bounces")
parser.add_only("cases")

CASES: dict[str, Callable[[bool], dict[str, float]]] = {
    "wall": bar_against_wall,
    "bars": bars,
    "energy": energy_in_contact,
    "pairs": energy_of_pairs,
    "bounces": bounces,
    "hertz": hertz,
    "friction": friction,
    "search": share_of_search,
}

# The most that each number may be.
BOUNDS = {
    "energy_drift": 1e-11,
    "linear_momentum_drift": 1e-12,
    "angular_momentum_drift": 1e-12,
    "duration_error": 0.02,
    "rebound_error": 0.02,
    "equal_speed_error": 0.02,
    "different_speed_error": 0.03,
    "height_error": 1e-9,
    "way_error": 0.01,
    "creep_by_theory": 1.01,
    "largest_gain_of_energy": 1e-12,
    "force_error": 0.03,
}
# Of 29 478 unknowns.
IN_FULL = {"search_by_step": 0.05, "search_of_skin_by_step": 0.05}
BOUNDS_OF = {"hertz": {"force_error": 0.05}}  # where a case has another


def main() -> None:
    """Run the cases and judge them."""
    options = parser.read()
    cases = {name: CASES[name](options.short) for name in chosen(options, CASES)}
    conclude(options.out, {**cases.get("wall", {}), "cases": cases})
    for name, found in cases.items():
        bounds = BOUNDS if options.short else {**BOUNDS, **IN_FULL}
        for number, most in {**bounds, **BOUNDS_OF.get(name, {})}.items():
            assert found.get(number, 0.0) <= most, (name, number, found[number])
    for name in {"energy", "pairs"} & set(cases):
        assert cases[name]["fewest_steps_in_contact"] >= (60 if options.short else 1000), name


if __name__ == "__main__":
    main()
