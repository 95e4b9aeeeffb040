"""A block falls on the floor, bounces, and is one body of few unknowns while it flies.

./fenicsx python3 demos/first/drop.py
"""

import numpy as np

import rigidfx as rf

HEIGHT, G = 0.05, 9.81  # m, m/s²
rubber = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)  # Pa, 1, kg/m³
block = rf.box((0, 0, HEIGHT), (0.1, 0.1, HEIGHT + 0.1), (2, 2, 2))
plane = rf.Plane((0, 0, 0), (0, 0, 1))
floor = rf.Contact("z0", against=plane, stiffness=1e7, title="floor")  # N/m³
damping = rf.StiffnessDamping(ratio=0.3, frequency=100.0)
scene = rf.Scene(block, rubber, [floor, rf.Gravity((0, 0, -G)), damping])

rule = rf.StrainRate(0.05, window=0.02)  # bodies: cells below this strain rate [1/s] for 20 ms
force, flying, books, energy = [], [], 0.0, 0.0
for report in rf.simulate(scene, dt=1e-3, t_end=0.25, rigidify=rule):
    books += report.work_of_loads - sum(report.dissipated.values())
    energy = max(energy, report.energy)
    flying.append(report.unknowns < 40)  # of 81
    force.append(report.touches["floor"].force[2] if report.step else 0.0)
    for event in report.events:
        print(f"{report.t:.3f} s: {event.kind}, {event.unknowns_after} unknowns ({event.reason})")

touched = np.flatnonzero(np.array(force) > 0)
touch = 1e-3 * touched[0]
print(
    f"touch at {touch:.3f} s, falls for {np.sqrt(2 * HEIGHT / G):.3f} s, {max(force):.0f} N at most"
)

assert abs(touch - np.sqrt(2 * HEIGHT / G)) < 3e-3
assert any(flying[: touched[0]])
assert not any(np.array(flying)[touched[3:8]])  # flexible soon after
assert abs(report.energy - books) < 1e-9 * energy
