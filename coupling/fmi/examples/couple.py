"""Couples the two units of a scene in FMPy: the rigid leg drives the deformable thigh, one-way or in passes back and forth.

    sartorius export-fmu SCENE --side rigid --out rigid.fmu
    sartorius export-fmu SCENE --side thigh --out thigh.fmu
    python examples/couple.py rigid.fmu thigh.fmu                      # as `sartorius compare`
    python examples/couple.py rigid.fmu thigh.fmu --two-way iqn-ils    # as `sartorius compare --two-way`

Needs FMPy 0.3.32 or later and NumPy. How it works: docs/fmi.md.
"""

import argparse
import csv
import math
import pathlib
import shutil
import sys

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi3 import FMU3Slave

# Fractions of the reported frames at which the gait steps are: heel strike and loading response.
STEPS = {"heel_strike": 0.0, "loading_response": 0.12}
# Changes of the capacity that count alike: of lengths [m], of forces [N], of the factor, of lever arms [m].
LENGTH, FORCE, FACTOR, ARM = 0.01, 100.0, 0.1, 0.01
BONES = ["pelvis", "thigh", "patella", "shank"]
KNEE = 3
TOLERANCE = 1e-3
# Columns of V that hold less than this fraction of themselves that is new are left out.
LEAST_NEW = 1e-3
# Factor of the first pass.
FIRST = {"relaxation": 0.5, "aitken": 0.5, "iqn-ils": 1.0}


class Unit:
    """A unit of which variables are arrays by their names."""

    def __init__(self, path):
        self.description = read_model_description(path, validate=False)
        self.folder = extract(path)
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.fmu = FMU3Slave(
            guid=self.description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName=pathlib.Path(path).stem,
        )
        self.fmu.instantiate(loggingOn=False)
        self.time = 0.0

    def names(self, name):
        """Texts of a constant."""
        return self.fmu.getString([self.variables[name].valueReference], nValues=math.prod(self.shape(name)))

    def shape(self, name):
        return tuple(int(d.start) for d in self.variables[name].dimensions)

    def get(self, name):
        variable, shape = self.variables[name], self.shape(name)
        getter = self.fmu.getBoolean if variable.type == "Boolean" else self.fmu.getFloat64
        values = getter([variable.valueReference], nValues=math.prod(shape))
        return np.array(values, dtype=bool if variable.type == "Boolean" else float).reshape(shape)

    def set(self, name, values):
        variable = self.variables[name]
        if variable.type == "Boolean":
            self.fmu.setBoolean([variable.valueReference], [bool(values)])
        else:
            self.fmu.setFloat64([variable.valueReference], np.ravel(values).astype(float).tolist())

    def initialize(self, start):
        self.fmu.enterInitializationMode(startTime=start)
        self.fmu.exitInitializationMode()
        self.time = start

    def step_to(self, time):
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=time - self.time)
        self.time = time

    def save(self):
        return self.fmu.getFMUState(), self.time

    def restore(self, saved):
        state, self.time = saved
        self.fmu.setFMUState(state)

    def free(self, saved):
        self.fmu.freeFMUState(saved[0])

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)


class FixedPoint:
    """Finds x = H(x): constant relaxation, Aitken's factor (Kuettler & Wall 2008), IQN-ILS (Degroote et al. 2009)."""

    def __init__(self, scheme):
        self.scheme, self.omega = scheme, FIRST[scheme]
        self.seen = []  # residuals and images
        self.columns, self.dropped = 0, 0

    def next(self, x, image):
        r = image - x
        if self.scheme == "iqn-ils" and self.seen:
            new = image + self.quasi_newton(r, image)
        else:
            if self.scheme == "aitken" and self.seen:
                before = self.seen[-1][0]
                change = r - before
                if change @ change > 0.0:
                    self.omega *= -(before @ change) / (change @ change)
            new = x + self.omega * r
        self.seen.append((r, image))
        return new

    def quasi_newton(self, r, image):
        q, w = [], []
        for older, older_image in reversed(self.seen):
            v, u = older - r, older_image - image
            size = np.linalg.norm(v)
            # Twice is enough for orthogonality to round-off.
            for _ in range(2):
                for qi, wi in zip(q, w):
                    along = qi @ v
                    v, u = v - along * qi, u - along * wi
            new = np.linalg.norm(v)
            if new > LEAST_NEW * size:
                q.append(v / new)
                w.append(u / new)
        self.columns, self.dropped = len(q), len(self.seen) - len(q)
        step = np.zeros_like(r)
        for qi, wi in zip(q, w):
            step -= (qi @ r) * wi
        return step


def gait_steps(rigid):
    """Names and times of the gait steps, and the distance of the frames of the trial."""
    experiment = rigid.description.defaultExperiment
    start, stop, dt = (float(v) for v in (experiment.startTime, experiment.stopTime, experiment.stepSize))
    last = round((stop - start) / dt)
    return {name: start + math.floor(last * fraction + 0.5) * dt for name, fraction in STEPS.items()}, dt


def drive(rigid, thigh):
    """Gives the thigh what the rigid leg says, and solves it."""
    for bone in BONES:
        thigh.set(f"{bone}.pose", rigid.get(f"{bone}.pose"))
        thigh.set(f"{bone}.twist", rigid.get(f"{bone}.twist"))
    thigh.set("activation", rigid.get("drive"))
    thigh.set("rigid_knee_arm", rigid.get("nominal_lever_arm")[:, KNEE])
    thigh.step_to(thigh.time + 1.0)


def nominal(rigid):
    """The capacity before the thigh has said anything, as numbers that count alike: a row per muscle."""
    return scaled(*(rigid.get(f"nominal_{name}") for name in ("fibre_elongation", "tissue_force", "through_belly", "lever_arm")))


def scaled(elongation, tissue, through_belly, arms):
    columns = [elongation / LENGTH, tissue / FORCE, (through_belly - 1.0) / FACTOR]
    return np.column_stack([*columns, arms / ARM])


def seen(thigh, before):
    """What the thigh shows, over what it was asked with, and which numbers it shows."""
    elongation, tissue, fraction = (thigh.get(n) for n in ("fibre_elongation", "tissue_force", "through_belly"))
    pulls, known = thigh.get("through_belly_known"), thigh.get("lever_arm_known")
    now = scaled(elongation, tissue, fraction, thigh.get("lever_arm"))
    shows = np.column_stack([pulls, np.ones_like(pulls), pulls, known])
    return np.where(shows, now, before), shows


def tell(rigid, capacity):
    """Gives the rigid leg what the muscles of the thigh can do."""
    rigid.set("with_capacity", True)
    rigid.set("fibre_elongation", LENGTH * capacity[:, 0])
    rigid.set("tissue_force", FORCE * capacity[:, 1])
    rigid.set("through_belly", 1.0 + FACTOR * capacity[:, 2])
    rigid.set("thigh_lever_arm", ARM * capacity[:, 3:])


def couple(rigid, thigh, scheme=None, passes=16, log=None):
    """Carries the thigh through the gait steps; rows per step, and the capacity of the last pass (step, muscle, number)."""
    times, dt = gait_steps(rigid)
    # From just before the first step, so that it too is a step to go back from.
    rigid.initialize(min(times.values()) - 0.25 * dt)
    thigh.initialize(0.0)
    before, solved, rows, image, shown = [], [], [], [], []
    for time in times.values():
        before.append(rigid.save())
        rigid.step_to(time)
        drive(rigid, thigh)
        solved.append(thigh.save())
        rows.append(results(rigid, thigh))
        capacity, shows = seen(thigh, nominal(rigid))
        image.append(capacity)
        shown.append(shows)
    if scheme is None:
        return times, rows, None
    x, shown = np.array(image), np.array(shown)
    ever, fixed_point, converged = shown.copy(), FixedPoint(scheme), False
    for iteration in range(1, passes):
        image, shows, rows = np.empty_like(x), np.empty_like(shown), []
        for k, time in enumerate(times.values()):
            rigid.restore(before[k])
            tell(rigid, x[k])
            rigid.step_to(time)
            thigh.restore(solved[k])
            drive(rigid, thigh)
            thigh.free(solved[k])
            solved[k] = thigh.save()
            rows.append(results(rigid, thigh))
            image[k], shows[k] = seen(thigh, x[k])
        change = np.linalg.norm(image - x) / np.linalg.norm(image)
        converged = change < TOLERANCE
        if log:
            log.pass_done(iteration, x, image, change)
        if converged:
            break
        # With other muscles at work it is another problem, of which the history knows nothing.
        if (shows != shown).any():
            fixed_point = FixedPoint(scheme)
        x = fixed_point.next(x.ravel(), image.ravel()).reshape(x.shape)
        # Seen for the first time: there is nothing to relax from.
        first = shows & ~ever
        x[first] = image[first]
        ever |= shows
        shown = shows
    if log:
        log.done(iteration, converged, fixed_point)
    for state in before:
        rigid.free(state)
    for state in solved:
        thigh.free(state)
    return times, rows, image


def results(rigid, thigh):
    """What is written of a step, a row per muscle."""
    return {
        "activation": rigid.get("drive"),
        "rigid_N": rigid.get("muscle_force"),
        "section_force_N": thigh.get("section_force"),
        "fibre_N": thigh.get("fibre_force"),
        "matrix_N": thigh.get("matrix_force"),
        "shell_N": thigh.get("shell_force"),
    }


class Log:
    """Iteration and convergence logs with the columns of preCICE: both steps together are the only time window."""

    QUANTITIES = {"Length": [0], "Tissue": [1], "Fraction": [2], "LeverArms": [3, 4, 5, 6]}

    def __init__(self, folder):
        self.folder, self.rows = folder, []
        self.convergence = open(folder / "couple-convergence.log", "w")
        columns = ["ResRel(Capacity)", *(f"ResRel({name})" for name in self.QUANTITIES)]
        print("TimeWindow  Iteration  " + "  ".join(columns), file=self.convergence)

    def pass_done(self, iteration, x, image, change):
        def relative(columns):
            size = np.linalg.norm(image[:, :, columns])
            return np.linalg.norm((image - x)[:, :, columns]) / size if size > 0.0 else 0.0

        numbers = [change, *(relative(columns) for columns in self.QUANTITIES.values())]
        print(f"1  {iteration}  " + "  ".join(f"{v:.8e}" for v in numbers), file=self.convergence)
        print(f"pass {iteration + 1}: capacity changes by {change:.2e}")

    def done(self, iterations, converged, fixed_point):
        self.convergence.close()
        with open(self.folder / "couple-iterations.log", "w") as file:
            print("TimeWindow  TotalIterations  Iterations  Convergence  QNColumns  DeletedQNColumns  DroppedQNColumns", file=file)
            counts = [1, iterations, iterations, int(converged), fixed_point.columns, 0, fixed_point.dropped]
            print("  ".join(map(str, counts)), file=file)


def write(folder, muscles, times, rows, capacity):
    with open(folder / "sections.csv", "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["step", "muscle", *rows[0]])
        for step, row in zip(times, rows):
            for m, muscle in enumerate(muscles):
                table.writerow([step, muscle, *(repr(float(v[m])) for v in row.values())])
    if capacity is None:
        return
    with open(folder / "capacities.csv", "w", newline="") as file:
        table = csv.writer(file)
        arms = ["hip_flexion_m", "hip_adduction_m", "hip_rotation_m", "knee_flexion_m"]
        table.writerow(["step", "muscle", "elongation_m", "tissue_N", "through_belly", *arms])
        for step, of_step in zip(times, capacity):
            for muscle, c in zip(muscles, of_step):
                numbers = [LENGTH * c[0], FORCE * c[1], 1.0 + FACTOR * c[2], *(ARM * c[3:])]
                table.writerow([step, muscle, *(repr(float(v)) for v in numbers)])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("rigid", help="unit of the rigid leg")
    parser.add_argument("thigh", help="unit of the thigh of the same scene")
    parser.add_argument("--two-way", choices=FIRST, help="passes back and forth, with this accelerator")
    parser.add_argument("--passes", type=int, default=16, help="passes at most")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out/couple"), help="folder for the results")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    rigid, thigh = Unit(arguments.rigid), Unit(arguments.thigh)
    muscles = thigh.names("muscles")
    if rigid.names("muscles") != muscles:
        sys.exit(f"the units are of other muscles: {rigid.names('muscles')} and {muscles}; export both from one scene")
    log = Log(arguments.out) if arguments.two_way else None
    times, rows, capacity = couple(rigid, thigh, arguments.two_way, arguments.passes, log)
    write(arguments.out, muscles, times, rows, capacity)
    for (step, time), row in zip(times.items(), rows):
        print(f"\n{step} ({time:.3f} s)\n  {'muscle':<28}{'drive':>10}{'rigid N':>10}{'FE N':>10}")
        for m, muscle in enumerate(muscles):
            print(f"  {muscle:<28}{row['activation'][m]:>10.3f}{row['rigid_N'][m]:>10.1f}{row['section_force_N'][m]:>10.1f}")
    rigid.close()
    thigh.close()


if __name__ == "__main__":
    main()
