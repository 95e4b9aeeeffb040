"""Steps of a mechanism by Exudyn, run by the Python that has it: arguments are two .npz files.

The first holds `kind`, `dt` and `steps`, with what the mechanism needs; the second gets the result.
Nothing of rigidfx is imported here.
"""

import sys
from time import perf_counter

import exudyn as exu
import exudyn.itemInterface as item
import numpy as np
from exudyn.FEM import FEMinterface, HCBstaticModeSelection, ObjectFFRFreducedOrderInterface
from exudyn.rigidBodyUtilities import RigidBodyInertia
from scipy.sparse import csr_matrix

POSITION = exu.OutputVariableType.Position
VELOCITY = exu.OutputVariableType.Velocity
TURNING = exu.OutputVariableType.AngularVelocity
SPECTRAL_RADIUS = 0.95  # of generalised α; Exudyn's own example of four-bars has it
DOWN = 9.81  # m/s²


def integrate(mbs, given):
    """Take the steps; seconds of one."""
    mbs.Assemble()
    settings = exu.SimulationSettings()
    time, steps = settings.timeIntegration, int(given["steps"])
    time.numberOfSteps, time.endTime = steps, steps * float(given["dt"])
    time.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = float(given["dt"])
    time.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
    time.generalizedAlpha.computeInitialAccelerations = True
    time.newton.useModifiedNewton = True
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    began = perf_counter()
    mbs.SolveDynamic(settings)
    return (perf_counter() - began) / steps


def four_bars(given):
    """Thin bars of 1 m and 1 kg in the plane, as Exudyn's example of IFToMM's A02 has them."""
    n = int(given["n"])
    mbs = exu.SystemContainer().AddSystem()
    ground = mbs.AddObject(item.ObjectGround())

    def bar(x, y, angle, velocity, turning):
        node = mbs.AddNode(
            item.NodeRigidBody2D(
                referenceCoordinates=[x, y, angle], initialVelocities=[velocity, 0, turning]
            )
        )
        body = mbs.AddObject(item.ObjectRigidBody2D(nodeNumber=node, mass=1.0, inertia=1 / 12))
        mass = mbs.AddMarker(item.MarkerBodyMass(bodyNumber=body))
        mbs.AddLoad(item.LoadMassProportional(markerNumber=mass, loadVector=[0, -DOWN, 0]))
        sensors = [
            mbs.AddSensor(
                item.SensorBody(bodyNumber=body, storeInternal=True, outputVariableType=kind)
            )
            for kind in (POSITION, VELOCITY, TURNING)
        ]
        ends = [
            mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=body, localPosition=[end, 0, 0]))
            for end in (-0.5, 0.5)
        ]
        return ends, sensors

    up = [bar(i, 0.5, np.pi / 2, 0.5, -1.0) for i in range(n + 1)]
    across = [bar(i + 0.5, 1.0, 0.0, 1.0, 0.0) for i in range(n)]
    pins = [
        (mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=ground, localPosition=[i, 0, 0])), bar[0])
        for i, (bar, _) in enumerate(up)
    ]
    for i, (bar, _) in enumerate(across):
        pins += [(up[i][0][1], bar[0]), (up[i + 1][0][1], bar[1])]
    for pair in pins:
        mbs.AddObject(item.ObjectJointRevolute2D(markerNumbers=list(pair)))
    seconds = integrate(mbs, given)
    energy = 0.0
    for _, sensors in (*up, *across):
        x, v, turning = (mbs.GetSensorStoredData(sensor)[:, 1:] for sensor in sensors)
        energy = energy + 0.5 * (v**2).sum(axis=1) + turning[:, 2] ** 2 / 24 + DOWN * x[:, 1]
    path = mbs.GetSensorStoredData(up[0][1][0])[:, 1:]
    return {"seconds": seconds, "energy": energy, "end": 2 * path[-1]}


def flexible(mbs, given, name, modes):
    """A body in a floating frame, with static modes of its two averaged faces and eigenmodes."""
    fem, pins = FEMinterface(), given[f"{name} pins"]
    points, pins, origin = given[f"{name} points"] - pins[0], pins - pins[0], pins[0]
    fem.nodes = {"Position": points}
    for matrix in ("mass", "stiffness"):
        parts = [given[f"{name} {matrix} {part}"] for part in ("data", "indices", "indptr")]
        setattr(fem, f"{matrix}Matrix", csr_matrix(tuple(parts), shape=(points.size,) * 2))
    faces = [given[f"{name} face {k}"] for k in range(2)]
    weights = [given[f"{name} weights {k}"] for k in range(2)]
    fem.ComputeHurtyCraigBamptonModes(
        boundaryNodesList=faces,
        boundaryNodesWeights=weights,
        nEigenModes=modes - 6,
        computationMode=HCBstaticModeSelection.RBE3,
    )
    reduced = ObjectFFRFreducedOrderInterface(fem)
    body = reduced.AddObjectFFRFreducedOrder(mbs, positionRef=origin)["oFFRFreducedOrder"]
    markers = [
        mbs.AddMarker(
            item.MarkerSuperElementRigid(
                bodyNumber=body,
                meshNodeNumbers=[int(node) for node in face],
                weightingFactors=weight,
                offset=pin - weight @ points[face],
            )
        )
        for face, weight, pin in zip(faces, weights, pins, strict=True)
    ]
    sensors = [
        mbs.AddSensor(
            item.SensorSuperElement(
                bodyNumber=body,
                meshNodeNumber=int(node),
                storeInternal=True,
                outputVariableType=POSITION,
            )
        )
        for node in given[f"{name} probes"]
    ]
    return markers, sensors


def slider_crank(given):
    """A crank and a rod in floating frames, a rigid slider; a torque drives the crank."""
    mbs, modes = exu.SystemContainer().AddSystem(), int(given["modes"])
    ground = mbs.AddObject(item.ObjectGround())
    (hub, pin), of_crank = flexible(mbs, given, "crank", modes)
    (big, small), of_rod = flexible(mbs, given, "rod", modes)
    at, guide = given["wrist"].tolist(), given["slider centre"]
    inertia = RigidBodyInertia(float(given["slider mass"]), given["slider inertia"])
    slider = mbs.CreateRigidBody(inertia=inertia, referencePosition=guide.tolist())

    def marker(body, place):
        return mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=body, localPosition=list(place)))

    def joint(a, b, held):
        mbs.AddObject(item.ObjectJointGeneric(markerNumbers=[a, b], constrainedAxes=held))

    joint(marker(ground, (0, 0, 0)), hub, [1, 1, 1, 1, 1, 0])
    joint(pin, big, [1, 1, 1, 1, 1, 0])
    joint(small, marker(slider, at - guide), [1, 1, 1, 0, 0, 0])
    joint(marker(ground, at), marker(slider, at - guide), [0, 1, 1, 1, 1, 1])
    times, torques = given["torque times"], given["torque"]

    def torque(mbs, t, load):
        return [0.0, 0.0, float(np.interp(t, times, torques))]

    mbs.AddLoad(
        item.LoadTorqueVector(markerNumber=hub, loadVector=[0, 0, 0], loadVectorUserFunction=torque)
    )
    seconds = integrate(mbs, given)
    found = {"seconds": seconds}
    for name, sensors in (("crank", of_crank), ("rod", of_rod)):
        found[name] = np.stack([mbs.GetSensorStoredData(s)[:, 1:] for s in sensors], axis=1)
    return found


def main(given_at, found_at):
    """Run what the file says."""
    given = dict(np.load(given_at))
    run = {"four-bars": four_bars, "slider-crank": slider_crank}[str(given["kind"])]
    np.savez(found_at, version=f"Exudyn {exu.config.Version()}", **run(given))


if __name__ == "__main__":
    main(*sys.argv[1:])
