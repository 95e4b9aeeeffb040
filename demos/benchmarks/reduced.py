"""Three levels by size: flexible, found by the run, and reduced by name.

Each scene runs whole, set-up included, on one core:

- flexible: the twin, in which all cells are flexible;
- default: what a user gets who names nothing, `StrainRate(Relative(0.01), "auto")`;
- reduced: parts named `Reduced`.

Δt is the same in all three. Scenes are:

* `plate`: a square plate of 1 m on soft springs is struck near a corner and beside its hub
  (`demos/gong.py`); also the peak of stress below the blows.
* `drop`: a device of three materials falls on a corner (`demos/drop_test.py`): it has six unknowns
  until a node presses, which gives it its shapes.
* `arm`: a robot's arm moves by a third of its way and swings (`demos/robot_arm.py`): link and head
  are reduced, its leaf stays flexible, and a moving support holds the link by its bore.
* `there and back`: the whole way of the demo, and back.
* `spin`: a bar spins freely by a turn and is struck at its end.
* `sine`: a block is driven by a lasting sine load below its first frequency; both halves reduced
  are one body, and one half is reduced beside the driven one.
* `crank`: the slider-crank of `demos/mechanism.py` for half a turn and its brake, three reduced
  parts between joints, a motor and a stop; also stress at the rod's fillet and the joints' gap.
* `tumbling`: a body of twelve shapes, with energy and momenta over ten thousand steps.

An entry of summary.json is a level of a scene at a size:

- case, level, unknowns (most of the twin), left (fewest of the run);
- seconds of the processor for the whole run, set-up included, and for `set_up` alone;
- ratio: seconds over those of the twin;
- memory: the most that the process has taken [MB];
- energy: largest error of its balance over the largest energy;
- errors against the twin, of what the scene is about.

`growth` tells the exponent of seconds by unknowns for each scene and level; `tumbling` has drifts.

    ./fenicsx python3 demos/benchmarks/reduced.py
    ./fenicsx python3 demos/benchmarks/reduced.py --only drop --levels flexible reduced
    ./fenicsx python3 demos/benchmarks/reduced.py --only plate --levels reduced --most 2000000
    ./fenicsx python3 demos/benchmarks/reduced.py --only plate --most 150000 --resume

Each run is a process of its own, so that memory is that of one run. Sizes up to 150 000 unknowns
take some hours of one core; with --resume a run that has been measured into the folder before is
not run again, and those of other scenes and sizes are in the table as well. A million unknowns have
no twin here: their run tells seconds and memory.
"""

import json
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from time import process_time

import numpy as np
from bench import Parser, alone, chosen, conclude
from common import Balance, machines, positive, say
from common.machines import TOUCH, pulse, ramp, travel

import rigidfx as rf
from meshes.gong import PLACES, SIDE
from meshes.mechanism import FILLET

SOFT = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)  # Pa, 1, kg/m³


@dataclass(frozen=True)
class Case:
    """A scene, the parts of it that are reduced, and what is compared."""

    scene: Callable[..., rf.Scene]  # makes it of some further effects
    parts: tuple[rf.Reduced, ...]  # the reduced parts
    dt: float | Mapping[float, float]  # time steps, as `simulate` takes them
    t_end: float  # end [s]
    seen: Callable[[rf.Report], np.ndarray]  # what is kept of a report
    # errors of what was seen in a run, by that of the twin
    errors: Callable[[np.ndarray, np.ndarray], dict[str, float]]


@dataclass
class Run:
    """What a run has left."""

    seconds: float = 0.0  # time of the processor, with set-up, without looks at results [s]
    unknowns: tuple[int, int] = (0, 0)  # the fewest and the most
    seen: np.ndarray = field(default_factory=lambda: np.empty(0))  # what was kept of each report
    balance: float = 0.0  # largest error of the balance of energy over the largest energy
    set_up: float = 0.0  # the part of its time that has passed before the first step [s]


def run(case: Case, parts: tuple[rf.Reduced, ...], rigidify: rf.StrainRate | None = None) -> Run:
    """A run of a case, with parts reduced by name, or rigid where a criterion finds them."""
    start, seen, unknowns, balance, looking = process_time(), [], [], Balance(), 0.0
    with warnings.catch_warnings():  # of blows that some of these cells do not resolve
        warnings.simplefilter("ignore", rf.RigidfxWarning)
        scene, set_up = case.scene(*parts), 0.0
        for report in rf.simulate(scene, dt=case.dt, t_end=case.t_end, rigidify=rigidify):
            began = process_time()
            set_up = set_up or began - start
            seen.append(case.seen(report))
            looking += process_time() - began
            unknowns.append(report.unknowns)
            balance.follow(report)
    ends = min(unknowns), max(unknowns)
    took = process_time() - start - looking
    return Run(took, ends, np.array(seen), balance.energy, set_up)


def of_way(own: np.ndarray, twin: np.ndarray) -> dict[str, float]:
    """Largest distance of a probe, over the largest way."""
    apart = np.linalg.norm(own - twin, axis=-1).max()
    return {"way": float(apart / np.linalg.norm(twin, axis=-1).max())}


def probes(report: rf.Report) -> np.ndarray:
    """Displacements of all probes [m]."""
    return np.array(list(report.probes.values()))


def plate(across: int) -> Case:
    """The gong, for half a second after the first blow."""
    blows = {"corner": 0.02, "side": 0.32}  # s
    corners = {"corner": (SIDE, SIDE, 0), "across": (0, 0, 0), "hub": (SIDE / 2, SIDE / 2, 0)}
    below = {f"below {name}": (*place, 0.0) for name, place in PLACES.items()}

    def scene(*parts: rf.Reduced) -> rf.Scene:
        return machines.gong_struck(across, blows, *parts, probes=corners | below)

    def seen(report: rf.Report) -> np.ndarray:
        stress = [report.stresses[name].von_mises if report.step else 0.0 for name in below]
        return np.r_[np.ravel([report.probes[name] for name in corners]), stress]

    def errors(own: np.ndarray, twin: np.ndarray) -> dict[str, float]:
        ways = (of[:, :9].reshape(-1, 3, 3) for of in (own, twin))
        peak = own[:, 9:].max() / twin[:, 9:].max() - 1
        return of_way(*ways) | {"peak_stress": float(peak)}

    return Case(scene, (rf.Reduced(),), 2e-3, 0.52, seen, errors)


def drop(size: float) -> Case:
    """The device, from its fall to the end of its first hit."""
    dt = 1e-4

    def scene(*parts: rf.Reduced) -> rf.Scene:
        return machines.device_dropped(machines.device_above_floor(size), *parts)

    def seen(report: rf.Report) -> np.ndarray:
        force = report.touches["floor"].force[2] if report.step else 0.0
        return np.array([force, report.linear_momentum[2]])

    def errors(own: np.ndarray, twin: np.ndarray) -> dict[str, float]:
        ends = [int(np.flatnonzero(of[:, 0] > 0)[-1]) + 1 for of in (own, twin)]
        rebound = own[ends[0], 1] / twin[ends[1], 1] - 1
        return {"peak_force": own[:, 0].max() / twin[:, 0].max() - 1, "rebound": float(rebound)}

    steps = {0.0: 1e-3, TOUCH - 10.5 * dt: dt}
    return Case(scene, (rf.Reduced(),), steps, TOUCH + 0.012, seen, errors)


def arm(size: float, distance: float = 0.05 / 3, back: float = np.inf) -> Case:
    """The arm, its axis moved by some way [m], and back from a time on [s], if before the end."""
    length = 0.04  # s

    def way(t: float) -> tuple[float, float, float]:
        there = travel(t / length) - travel((t - back) / length)
        return 0.0, distance * there, 0.0

    def scene(*parts: rf.Reduced) -> rf.Scene:
        return machines.arm_moved(size, way, rf.NumericalDamping(0.05), *parts)

    def seen(report: rf.Report) -> np.ndarray:
        return np.array(report.probes["tip"][1] - way(report.t)[1])

    def errors(own: np.ndarray, twin: np.ndarray) -> dict[str, float]:
        return {"swing": float(np.abs(own - twin).max() / np.abs(twin).max())}

    t_end = 0.12 if back == np.inf else back + 0.12
    return Case(scene, (rf.Reduced("link"), rf.Reduced("head")), 1e-3, t_end, seen, errors)


def spin(along: int) -> Case:
    """A bar that turns once, struck at its end at the start."""
    rate, t_end = 2 * np.pi / 0.4, 0.4  # rad/s, s
    across = max(2, along // 10)
    effects = [
        rf.InitialVelocity(angular=(0, 0, rate)),
        rf.Traction("x1", (0, 0, 2e3), time=pulse(0.0, 0.01)),
    ]
    ends = {"first": (0.0, 0.05, 0.05), "middle": (0.5, 0.05, 0.05), "last": (1.0, 0.05, 0.05)}

    def scene(*parts: rf.Reduced) -> rf.Scene:
        body = rf.box((0, 0, 0), (1.0, 0.1, 0.1), (along, across, across))
        return rf.Scene(body, SOFT, [*effects, *parts], element="enhanced", probes=ends)

    def errors(own: np.ndarray, twin: np.ndarray) -> dict[str, float]:
        bends = [of[:, 0, 2] - 2 * of[:, 1, 2] + of[:, 2, 2] for of in (own, twin)]
        off = np.abs(bends[0] - bends[1]).max() / np.abs(bends[1]).max()
        return of_way(own, twin) | {"deflection": float(off)}

    return Case(scene, (rf.Reduced(),), 1e-3, t_end, probes, errors)


def sine(which: str, cells: tuple[int, int, int] = (13, 13, 11)) -> Case:
    """A block on a wall, driven at 0.7 of its first frequency."""
    first = 9.3  # Hz, of the block
    push = rf.Traction("x1", (0, 0, 2e3), time=lambda t: np.sin(2 * np.pi * 0.7 * first * t))
    effects = [rf.Fixed("x0"), push, rf.StiffnessDamping(ratio=0.02, frequency=first)]

    def scene(*parts: rf.Reduced) -> rf.Scene:
        body = rf.box((0, 0, 0), (1.0, 0.5, 0.5), cells)
        body = body.with_cells("driven", lambda x: x[0] > 0.5 - 0.04)
        body = body.with_cells("held", lambda x: x[0] < 0.5 + 0.04)
        soft = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
        end = {"end": (1.0, 0.25, 0.25)}
        return rf.Scene(body, soft, [*effects, *parts], element="enhanced", probes=end)

    halves = {"both": (rf.Reduced("held"), rf.Reduced("driven")), "one": (rf.Reduced("held"),)}
    return Case(scene, halves[which], 5e-3, 1.5, probes, of_way)


def crank(size: float) -> Case:
    """The slider-crank of `demos/mechanism.py`, brought to speed, turned and stopped."""
    speed, rise = 100.0, 0.02  # rad/s, s
    brake = rise / 2 + np.pi / speed  # s
    effects = machines.crank_driven(lambda t: speed * (ramp(t / rise) - ramp((t - brake) / rise)))
    points = {"fillet": FILLET, "block": machines.BLOCK}

    def scene(*parts: rf.Reduced) -> rf.Scene:
        return machines.crank_scene(size, [*effects, *parts], points)

    def seen(report: rf.Report) -> np.ndarray:
        looked = report.step and report.step % 5 == 0
        stress = report.stresses["fillet"].von_mises if looked else 0.0
        gap = max((joint.gap for joint in report.joints.values()), default=0.0)
        return np.array([*probes(report).ravel(), stress, gap])

    def errors(own: np.ndarray, twin: np.ndarray) -> dict[str, float]:
        stress = np.abs(own[:, 6] - twin[:, 6]).max() / twin[:, 6].max()
        return of_way(own[:, 3:6], twin[:, 3:6]) | {"stress": stress, "gap": own[:, 7].max()}

    parts = tuple(rf.Reduced(name) for name in ("crank", "rod", "block"))
    return Case(scene, parts, 2e-4, brake + rise + 0.01, seen, errors)


def tumbling(steps: int) -> dict[str, object]:
    """Drifts of a body of twelve shapes, with both masses."""
    worst = dict.fromkeys(("energy", "momentum", "angular_momentum", "stretch"), 0.0)
    for mass in ("lumped", "consistent"):
        body = rf.box((0, 0, 0), (1.0, 0.1, 0.1), (12, 2, 2))
        soft = rf.StVenantKirchhoff(E=2e6, nu=0.3, rho=1000.0)
        thrown = rf.InitialVelocity(linear=(0.1, 0, 0), angular=(9.0, 10.0, 6.0))
        given, balance, stretch = [rf.Reduced(shapes=12), thrown], Balance(), 0.0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rf.RigidfxWarning)
            scene = rf.Scene(body, soft, given, mass=mass, element="enhanced")
            for report in rf.simulate(scene, dt=2e-3, t_end=2e-3 * steps):
                balance.follow(report)
                stretch = max(stretch, float(np.abs(report.state.bodies.q).max()))
        off = balance.energy, *balance.momenta, stretch
        worst = {name: max(worst[name], own) for name, own in zip(worst, off, strict=True)}
    return {"case": "tumbling", "steps": steps, "unknowns": 18} | worst


WHOLE = 0.05, 0.14  # m, s: the demo's way, and when its way back begins
SIZES: dict[str, dict[int, Callable[[], Case]]] = {  # by unknowns of the twin
    "plate": {
        1734: partial(plate, 16),
        6534: partial(plate, 32),
        25_350: partial(plate, 64),
        99_846: partial(plate, 128),
        1_043_334: partial(plate, 416),
    },
    "drop": {
        2736: partial(drop, 0.02),
        25_320: partial(drop, 0.0033),
        66_744: partial(drop, 0.0028),
        91_872: partial(drop, 0.0022),
    },
    "arm": {
        10_503: partial(arm, 0.016),
        20_997: partial(arm, 0.009),
        46_557: partial(arm, 0.006),
        102_636: partial(arm, 0.0044),
    },
    "there and back": {10_504: partial(arm, 0.016, *WHOLE), 20_998: partial(arm, 0.009, *WHOLE)},
    "spin": {1053: partial(spin, 38), 8427: partial(spin, 80)},
    "sine": {
        7056: partial(sine, "both"),
        7057: partial(sine, "one"),
        21_546: partial(sine, "both", (20, 18, 17)),
    },
    "crank": {
        12_951: partial(crank, 0.03),
        57_768: partial(crank, 0.0104),
        109_899: partial(crank, 0.0078),
    },
}
SHORT: dict[str, dict[int, Callable[[], Case]]] = {
    "plate": {1734: partial(plate, 16)},
    "drop": {2736: partial(drop, 0.02)},
    "spin": {567: partial(spin, 20)},
}


# Levels -------------------------------------------------------------------------------------------

LEVELS = "flexible", "default", "reduced"
TWINS_UP_TO = 150_000  # unknowns; a twin of a million takes a day
ENTRY, SEEN = "entry.json", "seen.npy"  # in the folder of a run


def carried_out(name: str, unknowns: int, level: str, short: bool, folder: Path) -> None:
    """Run a level of a scene, and keep what it leaves, its memory in a process of its own too."""
    case = (SHORT if short else SIZES)[name][unknowns]()
    found = rf.StrainRate(rf.Relative(0.01), "auto") if level == "default" else None
    own = run(case, case.parts if level == "reduced" else (), rigidify=found)
    left, most = own.unknowns
    entry = {"case": name, "level": level, "unknowns": most, "left": left, "set_up": own.set_up}
    entry |= {"seconds": own.seconds, "energy": own.balance}
    entry["memory"] = getrusage(RUSAGE_SELF).ru_maxrss // 1024
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / SEEN, own.seen)
    (folder / ENTRY).write_text(json.dumps(entry), encoding="utf-8")


def rows(name: str, unknowns: int, case: Case, out: Path) -> list[dict[str, object]]:
    """The levels of a scene that have been run, each beside the twin where there is one."""
    found = {level: out / f"{name}_{unknowns}_{level}" for level in LEVELS}
    found = {level: folder for level, folder in found.items() if (folder / ENTRY).exists()}
    entries = {
        level: json.loads((folder / ENTRY).read_text(encoding="utf-8"))
        for level, folder in found.items()
    }
    twin = entries.get("flexible")
    for level, entry in entries.items():
        if twin is not None and level != "flexible":
            entry["ratio"] = entry["seconds"] / twin["seconds"]
            seen, exact = (np.load(found[of] / SEEN) for of in (level, "flexible"))
            entry["errors"] = case.errors(seen, exact)
            entry["unknowns"] = twin["unknowns"]
        elif twin is None:
            entry["unknowns"] = unknowns
    return [*entries.values()]


def growth(table: list[dict[str, object]]) -> dict[str, float]:
    """Scene and level → exponent of seconds by unknowns, where there are three sizes."""
    found: dict[str, list[tuple[float, float]]] = {}
    for row in table:
        place = float(str(row["unknowns"])), float(str(row["seconds"]))
        found.setdefault(f"{row['case']}, {row['level']}", []).append(place)
    fits = {of: np.polyfit(*np.log(at).T, 1)[0] for of, at in found.items() if len(at) > 2}
    return {of: float(slope) for of, slope in fits.items()}


def main() -> None:
    """Run the scenes and write their table."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="coarse meshes")
    parser.add_only("scenes")
    parser.add_argument("--levels", nargs="+", default=[*LEVELS], choices=LEVELS, help="these")
    parser.add_argument("--least", type=positive, default=1, help="unknowns, at least")
    parser.add_argument("--most", type=positive, default=30_000, help="unknowns, at most")
    parser.add_argument("--resume", action="store_true", help="keep what has been measured")
    options = parser.read()
    sizes = SHORT if options.short else SIZES
    asked, table = chosen(options, [*sizes, "tumbling"]), []
    for name, made in sizes.items():
        for unknowns, make in made.items():
            wanted = name in asked and options.least <= unknowns <= options.most
            for level in options.levels if wanted else ():
                folder = options.out / f"{name}_{unknowns}_{level}"
                done = options.resume and (folder / ENTRY).exists()
                if not done and (level == "reduced" or unknowns <= TWINS_UP_TO):
                    alone(carried_out, name, unknowns, level, options.short, folder)
            if wanted or options.resume:
                table += (found := rows(name, unknowns, make(), options.out))
                say("\n".join(map(str, found)))
    found = {"rows": table, "growth": growth(table)}
    if "tumbling" in asked:
        found["tumbling"] = tumbling(500 if options.short else 10_000)
    conclude(options.out, found)
    assert all(row["energy"] < 1e-9 for row in table)
    assert "tumbling" not in found or found["tumbling"]["energy"] < 1e-9


if __name__ == "__main__":
    main()
