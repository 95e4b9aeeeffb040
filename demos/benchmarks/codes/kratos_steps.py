"""Steps of Kratos: total Lagrangian solids, Newmark's method without damping, full Newton.

It is run by an interpreter that has Kratos, and knows nothing of the rest:
kratos_steps.py GIVEN.npz FOUND.npz LINEAR_SOLVER STEPS.
"""

import json
import sys
from time import perf_counter

import KratosMultiphysics as KM
import KratosMultiphysics.LinearSolversApplication
import KratosMultiphysics.StructuralMechanicsApplication as SMA
import numpy as np
from KratosMultiphysics import python_linear_solver_factory

ELEMENT = {8: "TotalLagrangianElement3D8N", 10: "TotalLagrangianElement3D10N"}
TOLERANCE = 1e-6  # of Newton's residual, relative to the first or to the loads
SOLVERS = {
    "amgcl": {"solver_type": "amgcl", "tolerance": 1e-8, "max_iteration": 1000, "verbosity": 0},
    "sparse_lu": {"solver_type": "LinearSolversApplication.sparse_lu"},
}
AXES = "XYZ"


def model(given):
    """The nodes, cells, loads and supports as a part of a model."""
    part = KM.Model().CreateModelPart("part")
    part.SetBufferSize(2)
    for variable in (
        KM.DISPLACEMENT, KM.VELOCITY, KM.ACCELERATION, KM.REACTION, KM.VOLUME_ACCELERATION,
        SMA.POINT_LOAD,
    ):  # fmt: skip
        part.AddNodalSolutionStepVariable(variable)
    part.ProcessInfo[KM.DOMAIN_SIZE] = 3
    for k, x in enumerate(given["nodes"], 1):
        part.CreateNewNode(k, *map(float, x))
    properties = part.CreateNewProperties(1)
    names = (KM.YOUNG_MODULUS, KM.POISSON_RATIO, KM.DENSITY)
    for name, value in zip(names, given["material"], strict=True):
        properties.SetValue(name, float(value))
    properties.SetValue(KM.CONSTITUTIVE_LAW, SMA.LinearElastic3DLaw())
    kind = ELEMENT[given["cells"].shape[1]]
    for k, nodes in enumerate(given["cells"], 1):
        part.CreateNewElement(kind, k, [int(n) for n in nodes], properties)
    loaded = np.flatnonzero(given["forces"].any(axis=1))
    for k, node in enumerate(loaded, 1):
        part.CreateNewCondition("PointLoadCondition3D1N", k, [int(node) + 1], properties)
    for axis in AXES:
        names = (getattr(KM, f"{kind}_{axis}") for kind in ("DISPLACEMENT", "REACTION"))
        KM.VariableUtils().AddDof(*names, part)
    for node in given["held"]:
        for axis in AXES:
            part.GetNode(int(node)).Fix(getattr(KM, f"DISPLACEMENT_{axis}"))
    return part, loaded


def strategy(part, solver, floor):
    """Newmark's method and Newton's; the floor is of the residual over the number of unknowns."""
    linear = python_linear_solver_factory.ConstructSolver(
        KM.Parameters(json.dumps(SOLVERS[solver]))
    )
    made = KM.ResidualBasedNewtonRaphsonStrategy(
        part,
        KM.ResidualBasedBossakDisplacementScheme(0.0),
        KM.ResidualCriteria(TOLERANCE, floor),
        KM.ResidualBasedBlockBuilderAndSolver(linear),
        25,
        False,
        False,
        True,
    )
    made.SetEchoLevel(0)
    made.Initialize()
    return made


def values(part, variable):
    """A vector of all nodes."""
    return np.array([node.GetSolutionStepValue(variable) for node in part.Nodes])


def main(given_at, found_at, solver, steps):
    """Run."""
    KM.Logger.GetDefaultOutput().SetSeverity(KM.Logger.Severity.WARNING)
    given = dict(np.load(given_at))
    part, loaded = model(given)
    floor = TOLERANCE * np.linalg.norm(given["forces"]) / given["forces"].size
    newton = strategy(part, solver, floor)
    dt, failed = float(given["dt"]), ""
    found = {"seconds": [], "newton": [], "u": [], "v": []}
    for step in range(1, int(steps) + 1):
        t = step * dt
        part.CloneTimeStep(t)
        part.ProcessInfo[KM.STEP] = step
        factor = float(np.interp(t, given["times"], given["factors"]))
        for node in loaded:
            force = [float(f) * factor for f in given["forces"][node]]
            part.GetNode(int(node) + 1).SetSolutionStepValue(SMA.POINT_LOAD, force)
        start = perf_counter()
        newton.InitializeSolutionStep()
        newton.Predict()
        converged = newton.SolveSolutionStep()
        newton.FinalizeSolutionStep()
        found["seconds"].append(perf_counter() - start)
        found["newton"].append(part.ProcessInfo[KM.NL_ITERATION_NUMBER])
        found["u"].append(values(part, KM.DISPLACEMENT))
        found["v"].append(values(part, KM.VELOCITY))
        if not converged or not np.isfinite(found["u"][-1]).all():
            failed = f"step {step} did not converge"
            break
    np.savez(found_at, failed=failed, **found)


if __name__ == "__main__":
    main(*sys.argv[1:])
