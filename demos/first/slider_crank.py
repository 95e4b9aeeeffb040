"""A crank, a flexible rod and a slider: joints, a motor, a stress that follows from the motion.

./fenicsx python3 demos/first/slider_crank.py
"""

import numpy as np

import rigidfx as rf


def block(low, high, cells):
    """Points and hexahedra of a bar along x."""
    x = np.linspace(low[0], high[0], cells + 1)
    points = [(a, y, z) for a in x for y in (low[1], high[1]) for z in (low[2], high[2])]
    corners = 4 * np.arange(cells)[:, None] + np.arange(8)
    return np.array(points), corners


# Three parts that share no node: the rod lies between the pins at x = 0.1 and x = 0.5 m.
parts = [
    block((0.01, -0.01, -0.01), (0.09, 0.01, 0.01), 1),  # crank
    block((0.12, -0.01, -0.01), (0.48, 0.01, 0.01), 18),  # rod
    block((0.52, -0.02, -0.02), (0.58, 0.02, 0.02), 1),  # slider
]
first = np.cumsum([0, *(len(points) for points, _ in parts)])
cells = [corners + k for (_, corners), k in zip(parts, first[:-1], strict=True)]
domain = rf.from_arrays(np.concatenate([points for points, _ in parts]), np.concatenate(cells))
domain = domain.with_cells("crank", lambda x: x[0] < 0.1)
domain = domain.with_cells("slider", lambda x: x[0] > 0.5)
domain = domain.with_facets("big end", lambda x: (x[0] > 0.1) & (x[0] < 0.141))
domain = domain.with_facets("small end", lambda x: (x[0] > 0.459) & (x[0] < 0.5))

z = (0, 0, 1)
effects = [
    *(rf.Rigid(part) for part in ("crank", "slider")),
    rf.Revolute("ground", "crank", (0, 0, 0), z, name="bearing"),
    rf.Revolute("crank", rf.MeanFace("big end"), (0.1, 0, 0), z, name="crank pin"),
    rf.Spherical(rf.MeanFace("small end"), "slider", (0.5, 0, 0), name="wrist pin"),
    rf.Prismatic("ground", "slider", (0.5, 0, 0), (1, 0, 0), name="guide"),
    rf.Motor("bearing", speed=lambda t: 20 * min(t / 0.1, 1) ** 2),  # rad/s
    rf.ResolvedForces(),  # the torque without vibration that Δt does not resolve
]
aluminium = rf.StVenantKirchhoff(rho=2700.0, E=7e10, nu=0.3)
scene = rf.Scene(domain, aluminium, effects, element="enhanced", mass="consistent")

work = 0.0
for report in rf.simulate(scene, dt=1e-3, t_end=0.2):
    work += report.work_of_loads
    if report.step and report.step % 20 == 0:
        bearing, guide = report.joints["bearing"], report.joints["guide"]
        torque = bearing.efforts["Motor of 'bearing'"]
        print(
            f"{report.t:.2f} s  {bearing.angle:6.3f} rad  {torque:7.3f} N m  {guide.travel:+.4f} m"
        )

angle = report.joints["bearing"].angle
exact = 0.1 * np.cos(angle) + np.sqrt(0.4**2 - (0.1 * np.sin(angle)) ** 2) - 0.5
assert abs(report.joints["guide"].travel - exact) < 1e-5  # m
assert abs(report.energy - work) < 1e-12
