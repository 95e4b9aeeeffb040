"""A clamped bar is loaded at its end at once: it swings to twice its static deflection.

./fenicsx python3 demos/first/bar.py
"""

import numpy as np

import rigidfx as rf

L, H = 1.0, 0.05  # m
E, NU, RHO = 2.1e11, 0.3, 7850.0  # Pa, 1, kg/m³
FORCE = 100.0  # N, at the end

bar = rf.box((0, 0, 0), (L, H, H), (20, 1, 1))  # its faces are named x0 … z1
effects = [rf.Fixed("x0"), rf.Traction("x1", (0, 0, FORCE / H**2))]
steel = rf.StVenantKirchhoff(E=E, nu=NU, rho=RHO)
scene = rf.Scene(bar, steel, effects, element="enhanced", probes={"tip": (L, H / 2, H / 2)})

# The beam of Euler and Bernoulli has the deflection F L³/3EI, and its first frequency ω₁.
stiffness = E * H**4 / 12  # N m²
static = FORCE * L**3 / (3 * stiffness)  # m
period = 2 * np.pi * L**2 / 1.8751**2 * np.sqrt(RHO * H**2 / stiffness)  # s

times, tip = [], []
for report in rf.simulate(scene, dt=period / 40, t_end=period):
    times.append(report.t)
    tip.append(report.probes["tip"][2])

print(f"largest deflection {1e3 * max(tip):.4f} mm, static {1e3 * static:.4f} mm")
print(f"first period {1e3 * period:.2f} ms, largest at {1e3 * times[np.argmax(tip)]:.2f} ms")

assert abs(max(tip) / (2 * static) - 1) < 0.03
assert abs(times[np.argmax(tip)] / (period / 2) - 1) < 0.06
assert abs(tip[-1]) < 0.1 * max(tip)
