"""Random scenes as plain data, what becomes of them, and hundreds of them.

A draft says all of a scene in numbers and names that JSON can carry to other ranks. Velocities and
loads are so small against the stiffness that strains stay at some per cent; all else is at random,
so that many drafts contradict themselves.
"""

import warnings
from collections import Counter
from contextlib import closing
from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import rigidfx as rf

from .case import ANY, History

FACES = ("x0", "x1", "y0", "y1", "z0", "z1")
ERROR, BALANCED = "error before the first step", "balanced"
BOUND = 1e-8  # of the balance of energy, relative: stiffness ratios of 1e4 magnify rounding

Draft = dict[str, Any]


def _choice(*values: Any) -> st.SearchStrategy:
    return st.sampled_from(values)


def _number(low: float, high: float) -> st.SearchStrategy:
    return st.floats(low, high, allow_nan=False)


_vector = st.tuples(*[_number(-1, 1)] * 3)
_window = st.one_of(st.none(), st.tuples(_number(0, 10), _number(10.5, 20)))  # steps
_sets = _choice("left", "right", "middle", "corner")
_loads = st.fixed_dictionaries(
    {
        "kind": _choice("Traction", "NodalForce", "BodyForce", "Gravity", "of place"),
        "where": _choice(*FACES),
        "value": _vector,
        "window": _window,
        "time": _choice("constant", "ramp", "sine", "alternating"),
    }
)
_supports = st.fixed_dictionaries(
    {
        "kind": _choice("Fixed", "PrescribedMotion", "of place", "PrescribedRotation"),
        "where": _choice(*FACES),
        "components": _choice("xyz", "xyz", "x", "yz", "z"),
        "value": _vector,
        "window": _window,
    }
)
_contacts = st.fixed_dictionaries(
    {
        "kind": _choice("plane", "sphere", "tube", "itself"),
        "where": _choice(*FACES),
        "away": _number(-0.1, 1.0),  # of the way in ten steps
        "friction": _choice(0.0, 0.0, 0.3),
        "window": _window,
    }
)
_criteria = st.fixed_dictionaries(
    {
        "tol": _choice(0.0, 1e-6, 1e-2, 0.3, 10.0, ANY, ANY),
        "window": _choice("auto", 2, 5),
        "measure": _choice("rms", "paper"),
        "tolerances": st.dictionaries(_sets, _choice(0.0, ANY), max_size=2),
        "never": st.lists(_sets, max_size=1),
        "release": st.lists(_number(1, 20), max_size=2),
        "condition": st.booleans(),
        "min_cells": _choice(1, 1, 3),
        "load_change": _choice(0.1, np.inf),
        "wake": _choice("all", "local", "none"),
    }
)
drafts = st.fixed_dictionaries(
    {
        "cell": _choice("hexahedron", "tetrahedron"),
        "cells": st.tuples(st.integers(1, 5), st.integers(1, 2), st.integers(1, 2)),
        "edges": st.tuples(*[_number(-0.7, 0.7)] * 3),  # powers of ten
        "two materials": st.booleans(),
        "E": st.tuples(_number(2, 8), _number(-2, 2)),  # powers of ten; the second relative
        "rho": st.tuples(_number(-1, 4), _number(-2, 2)),
        "nu": _number(-0.3, 0.45),
        "mass": _choice("lumped", "consistent"),
        "element": _choice("standard", "enhanced", "assumed"),
        "dt": _number(-1.5, 1.5),
        "steps": st.integers(4, 20),
        "linear": _vector,
        "angular": _vector,
        "speed": _choice(0.0, 1.0),
        "loads": st.lists(_loads, max_size=2),
        "supports": st.lists(_supports, max_size=2),
        "rigid": st.lists(_sets, max_size=2, unique=True),
        "contacts": st.lists(_contacts, max_size=1),
        "xi": _choice(0.0, 0.0, 0.1, 0.5),
        "damping": _choice(0.0, 0.0, 0.1),
        "criterion": st.one_of(st.none(), _criteria),
        "control": _choice(None, None, None, 0.3, 0.01),
        "accuracy": _choice(None, None, None, None, 0.3, 0.01),
    }
)


def build(
    draft: Draft,
) -> tuple[rf.Scene, float | rf.StepControl, float, rf.StrainRate | rf.Accuracy | None]:
    """Scene, Δt, end and criterion of a draft."""
    edges = 10.0 ** np.array(draft["edges"])
    size = edges * draft["cells"]
    middle = 0.5 * size[0]
    near = 1e-6 * size[0]
    domain = rf.box((0, 0, 0), size, draft["cells"], draft["cell"])
    domain = domain.with_cells("left", lambda x: x[0] <= edges[0] + near)
    markers = {
        "right": lambda x: x[0] >= size[0] - edges[0] - near,
        "middle": lambda x: np.abs(x[0] - middle) <= edges[0] + near,
        "corner": lambda x: (x <= edges[:, None] * (1 + 1e-6)).all(axis=0),
    }
    for name, marker in markers.items():
        domain = domain.with_cells(name, marker)
    domain = domain.with_facets("skin", lambda x: np.full(x.shape[1], True))
    E, rho = ([10.0 ** draft[name][0], 10.0 ** sum(draft[name])] for name in ("E", "rho"))
    material: Any = rf.StVenantKirchhoff(E=E[0], nu=draft["nu"], rho=rho[0])
    if draft["two materials"]:
        owned = domain.mesh.topology.index_map(3)
        every = np.arange(owned.size_local + owned.num_ghosts)
        rest = np.setdiff1d(every, domain.find("left", (3,), "draft").entities)
        domain = domain.with_cell_set("rest", rest)
        material = {"left": material, "rest": rf.NeoHooke(E=E[1], nu=draft["nu"], rho=rho[1])}
    else:
        E, rho = E[:1], rho[:1]
    c, E0 = np.sqrt(min(E) / max(rho)), min(E)
    dt = float(edges.min() / c * 10 ** draft["dt"])
    slow = 1e-3 * c * min(1.0, edges.min() / size.max()) ** 2
    effects: list[rf.effects.Effect] = [rf.NumericalDamping(draft["xi"])]
    if draft["speed"]:
        linear = tuple(slow * np.array(draft["linear"]))
        angular = tuple(5 * slow / size.max() * np.array(draft["angular"]))
        effects.append(rf.InitialVelocity(linear=linear, angular=angular))
    pressure = 1e-3 * E0 * (edges.min() / size.max()) ** 3
    for load in draft["loads"]:
        effects.append(_load(load, dt, pressure, size, max(rho)))
    for support in draft["supports"]:
        effects.append(_support(support, dt, slow, float(size.max())))
    for contact in draft["contacts"]:
        effects.append(_contact(contact, dt, slow, size))
    if draft["damping"]:
        effects.append(rf.StiffnessDamping(draft["damping"], 0.1 / dt))
    effects += [rf.Rigid(name) for name in draft["rigid"]]
    # what the enhanced element refuses has tests of its own
    able = draft["cell"] == "hexahedron" and not draft["two materials"]
    element = draft["element"] if able else "standard"
    if element == "assumed":
        element = rf.AssumedStrains("z1")
    scene = rf.Scene(domain, material, effects, mass=draft["mass"], element=element)
    if budget := draft.get("accuracy"):
        accuracy = rf.Accuracy(budget, smallest=dt / 8, min_cells=1)
        return scene, dt, draft["steps"] * dt, accuracy
    tol = draft.get("control")
    control = dt if tol is None else rf.StepControl(tol, largest=dt, smallest=dt / 8)
    return scene, control, draft["steps"] * dt, _criterion(draft["criterion"], dt)


def _times(window: Any, dt: float) -> dict[str, float]:
    return {} if window is None else {"since": window[0] * dt, "until": window[1] * dt}


def _load(load: Draft, dt: float, pressure: float, size: Any, rho: float) -> rf.effects.Effect:
    time = {
        "constant": None,
        "ramp": rf.Table((0.0, 3.3 * dt, 7.1 * dt), (0.0, 1.0, 0.3)),
        "sine": lambda t: float(np.sin(t / dt)),
        "alternating": lambda t: 1.0 if int(t / dt) % 2 else -1.0,
    }[load["time"]]
    value, where = np.array(load["value"]), load["where"]
    options = {"time": time, **_times(load["window"], dt)}
    if load["kind"] == "Traction":
        return rf.Traction(where, tuple(pressure * value), **options)
    if load["kind"] == "of place":
        return rf.Traction(
            where, lambda x, t: pressure * value[:, None] * x / size.max(), **options
        )
    if load["kind"] == "NodalForce":
        area = float(np.min(size)) ** 2
        return rf.NodalForce(where, tuple(pressure * area * value), **options)
    if load["kind"] == "BodyForce":
        return rf.BodyForce(tuple(pressure / size.max() * value), **options)
    return rf.Gravity(tuple(pressure / size.max() / rho * value), **options)


def _support(support: Draft, dt: float, slow: float, size: float) -> rf.effects.Effect:
    times, where = _times(support["window"], dt), support["where"]
    if support["kind"] == "Fixed":
        return rf.Fixed(where, support["components"], **times)
    start = times.get("since", 0.0)
    value = slow * np.array(support["value"])
    if support["kind"] == "of place":
        return rf.PrescribedMotion(
            where,
            support["components"],
            displacement=lambda x, t: value[:, None] * (t - start) * x[:1] / size,
            **times,
        )
    if support["kind"] == "PrescribedRotation":
        axis = (*support["value"][:2], support["value"][2] + 2.0)
        return rf.PrescribedRotation(
            where, axis=axis, angle=lambda t: slow / size * (t - start), **times
        )
    return rf.PrescribedMotion(
        where,
        support["components"],
        displacement=lambda t: tuple(value * (t - start)),
        velocity=lambda t: tuple(value),
        **times,
    )


def _contact(contact: Draft, dt: float, slow: float, size: Any) -> rf.effects.Effect:
    """A face against an obstacle before it, or a little inside it, which refuses what is deeper.

    Or all faces against each other: they do not meet, but they are looked at, and wake.
    """
    if contact["kind"] == "itself":
        return rf.Contact("skin", against="skin", **_times(contact["window"], dt))
    axis, high = "xyz".index(contact["where"][0]), contact["where"][1] == "1"
    n = np.zeros(3)
    n[axis] = -1.0 if high else 1.0
    gap = contact["away"] * 10 * dt * slow
    middle = 0.5 * np.asarray(size)
    foot = middle.copy()
    foot[axis] = size[axis] if high else 0.0
    foot -= gap * n
    radius = 4 * float(np.max(size))
    obstacle: Any = rf.Plane(tuple(foot), tuple(n))
    if contact["kind"] == "sphere":
        obstacle = rf.Sphere(tuple(foot - radius * n), radius)
    elif contact["kind"] == "tube":
        across = tuple(np.roll(n, 1))
        room = float(np.linalg.norm(size)) + gap
        obstacle = rf.Cylinder(tuple(middle), room, axis=across, inside=True)
    times = _times(contact["window"], dt)
    friction = contact["friction"]
    return rf.Contact(contact["where"], against=obstacle, friction=friction, creep=0.01 * slow,
                      **times)  # fmt: skip


def _criterion(draft: Draft | None, dt: float) -> rf.StrainRate | None:
    if draft is None:
        return None
    release = [rf.Release(at=[t * dt for t in draft["release"]])] if draft["release"] else []
    if draft["condition"]:
        release.append(rf.Release(when=lambda report: report.step % 3 == 0))
    window = draft["window"]
    return rf.StrainRate(
        draft["tol"],
        window if window == "auto" else window * dt,
        measure=draft["measure"],
        wake=draft["wake"],
        tolerances=draft["tolerances"],
        never=draft["never"],
        release=release,
        min_cells=draft["min_cells"],
        patience=1.0 if draft["wake"] == "local" else 2.0,  # whatever switches cost
        load_change=draft["load_change"] if draft["wake"] == "all" else None,
    )


def _rounding(draft: Draft) -> float:
    """Rounding of strain energies [J].

    A stored energy like neo-Hooke's, tr C - 3 - ln det C, is the small difference of numbers near
    one: at a strain e it is known to ε/e² of itself only, here to ε E V.
    """
    volume = np.prod(10.0 ** np.array(draft["edges"]) * draft["cells"])
    E = 10.0 ** draft["E"][0] * max(1.0, 10.0 ** draft["E"][1])
    return float(100 * np.finfo(float).eps * E * volume)


def outcome(draft: Draft) -> str:
    """What becomes of a draft: an error before the first step, a balanced run, or what is wrong."""
    history, gains, lost = History(), [0.0], [0.0]
    try:
        scene, dt, t_end, criterion = build(draft)
        whose = "accuracy" if isinstance(criterion, rf.Accuracy) else "rigidify"
        with closing(rf.simulate(scene, dt, t_end, **{whose: criterion})) as reports:
            for r in reports:
                history.add(r)
                numbers = [r.energy, r.work_of_loads, r.work_of_supports, *r.linear_momentum]
                if not np.isfinite([*numbers, *r.angular_momentum]).all():
                    return f"not finite at step {r.step}"
                if not np.isfinite(r.state.u.x.array).all():
                    return f"displacement is not finite at step {r.step}"
                if r.step:
                    lost.append(sum(event.energy_lost for event in r.events))
                    gains.append(history.balance.gain + lost[-1])
    except (rf.SceneError, rf.StepError) as error:
        steps = len(history.iterations)
        if steps == 0 and isinstance(error, rf.SceneError):
            return ERROR
        return f"{type(error).__name__} after step {steps}: {error}"
    off, scale = float(np.abs([*gains, *lost]).max()), history.balance.largest
    if off > BOUND * scale + _rounding(draft):
        return f"energy is off by {off / scale:.1e}"
    return BALANCED


def try_scenes(number: int) -> dict[str, int]:
    """Draw scenes, the same on every machine, and follow each; how many ended how. Collective.

    It fails if a scene neither refuses its input nor keeps its balances.
    """
    seen: Counter[str] = Counter()

    @settings(
        max_examples=number,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(drafts)
    def tried(draft: dict) -> None:
        found = outcome(draft)
        seen[found] += 1
        assert found in (ERROR, BALANCED), f"{found}\n{draft}"

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rf.RigidfxWarning)
        tried()
    return dict(seen)
