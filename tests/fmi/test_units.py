"""Are the units what FMI 3.0 wants, do they go back to the last bit, and does a coupling in FMPy say what `compare` says?

    pip install fmpy==0.3.32 numpy pytest
    cargo build --release && pytest tests/fmi
"""

import csv
import ctypes
import gc
import hashlib
import math
import os
import pathlib
import re
import struct
import subprocess
import sys
import time

import fmpy
import numpy as np
import pytest
from fmpy import fmi3
from fmpy.validation import validate_fmu

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "coupling/fmi/examples"))
from couple import Unit, couple, gait_steps  # noqa: E402

SARTORIUS = os.environ.get("SARTORIUS", str(ROOT / "target/release/sartorius"))
THREE = 'muscles = ["adductor_magnus", "semimembranosus", "vastus_lateralis"]\nresolution_mm = 20.0\n'
REST = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]


def sartorius(*arguments, code=0, cwd=None):
    done = subprocess.run([SARTORIUS, *map(str, arguments), "--quiet"], capture_output=True, text=True, cwd=cwd)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("units")
    (folder / "three.toml").write_text(THREE)
    for name, more in [("rigid", ["--side", "rigid"]), ("contact", ["--side", "thigh"]),
                       ("alone", ["--side", "thigh", "--contact", "without", "--also", "displacements,stiffness"])]:
        sartorius("export-fmu", folder / "three.toml", "--out", folder / f"{name}.fmu", *more)
    return folder


@pytest.fixture
def units(folder):
    made = []

    def unit(name):
        made.append(Unit(str(folder / f"{name}.fmu")))
        return made[-1]

    yield unit
    for one in made:
        one.fmu.freeInstance()


def bits(values):
    return [struct.pack("<d", v) for v in np.ravel(values)]


def wrong(call, *words):
    """A call that the unit refuses; what it said."""
    with pytest.raises(fmpy.fmi1.FMICallException) as caught:
        call()
    assert caught.value.status == fmi3.fmi3Error
    for word in words:
        assert any(word in said for said in SAID), (word, SAID)
    SAID.clear()


SAID = []


@pytest.fixture(autouse=True)
def listen(monkeypatch):
    SAID.clear()
    monkeypatch.setattr(fmi3, "printLogMessage", lambda environment, status, category, message: SAID.append(message.decode()))


@pytest.mark.parametrize("name", ["rigid", "contact", "alone"])
def test_validate_finds_nothing(folder, name):
    assert validate_fmu(str(folder / f"{name}.fmu")) == []
    for variable in fmpy.read_model_description(str(folder / f"{name}.fmu")).modelVariables:
        assert variable.description, variable.name
    done = subprocess.run([sys.executable, "-m", "fmpy", "validate", str(folder / f"{name}.fmu")], capture_output=True, text=True)
    assert done.returncode == 0 and "No problems found" in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize("name", ["rigid", "contact"])
def test_simulate_runs_to_the_end(folder, name):
    result = fmpy.simulate_fmu(str(folder / f"{name}.fmu"), validate=True)
    experiment = fmpy.read_model_description(str(folder / f"{name}.fmu")).defaultExperiment
    assert math.isclose(result["time"][-1], float(experiment.stopTime), rel_tol=1e-9)
    assert not SAID
    command = [sys.executable, "-m", "fmpy", "simulate", folder / f"{name}.fmu", "--output-file", folder / f"{name}.csv"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    assert done.returncode == 0 and (folder / f"{name}.csv").is_file(), done.stdout + done.stderr


def test_units_that_are_exported_twice_are_the_same_bytes(folder):
    sartorius("export-fmu", folder / "three.toml", "--side", "thigh", "--out", folder / "again.fmu")
    assert (folder / "again.fmu").read_bytes() == (folder / "contact.fmu").read_bytes()


def test_every_function_of_the_standard_is_there_and_takes_nothing_amiss(units):
    # The header of the standard, as FMPy carries it.
    header = (pathlib.Path(fmpy.__file__).parent / "c-code/fmi3FunctionTypes.h").read_text()
    functions = sorted(set(re.findall(r"\b(fmi3\w+)TYPE\b", header)))
    assert len(functions) == 75, len(functions)
    unit = units("rigid")
    # Functions without the types that FMPy gives them.
    library = ctypes.CDLL(unit.fmu.dll._name)
    instance = ctypes.c_void_p(unit.fmu.component)
    foreign = ctypes.c_void_p(0x1000)
    for name in functions:
        function = getattr(library, name)
        function.restype = ctypes.c_int
        if name == "fmi3GetVersion":
            function.restype = ctypes.c_char_p
            assert function() == b"3.0"
            continue
        if name.startswith("fmi3Instantiate"):
            function.restype = ctypes.c_void_p
            assert function(*[ctypes.c_void_p()] * 12) is None
            continue
        # No instance, a foreign one, and a good one with null for everything else: never a crash, an error where there is anything to say.
        for handle in (ctypes.c_void_p(), foreign, instance):
            if name == "fmi3FreeInstance" and handle is instance:
                continue
            status = function(handle, *[ctypes.c_void_p()] * 11)
            if name != "fmi3FreeInstance":
                assert handle is instance or status == fmi3.fmi3Error, name
                assert status in (fmi3.fmi3OK, fmi3.fmi3Error), (name, status)


@pytest.mark.parametrize("name", ["rigid", "contact"])
def test_a_state_goes_back_to_the_last_bit(units, folder, name):
    unit = units(name)
    rigid = units("rigid")
    times, dt = gait_steps(rigid)
    start = min(times.values()) - 0.25 * dt

    def step(time):
        if name != "rigid":
            rigid.restore(ready) if rigid.time >= time else None
            rigid.step_to(time)
            for bone in ("pelvis", "thigh", "patella", "shank"):
                unit.set(f"{bone}.pose", rigid.get(f"{bone}.pose"))
                unit.set(f"{bone}.twist", rigid.get(f"{bone}.twist"))
            unit.set("activation", rigid.get("drive"))
        unit.step_to(time)

    def everything():
        names = [n for n, v in unit.variables.items() if v.type != "String"]
        return {n: bits(unit.get(n)) for n in names}

    rigid.initialize(start)
    ready = rigid.save()
    unit.initialize(start)
    first, second = times.values()
    step(first)
    saved, at_first = unit.save(), everything()
    step(second)
    at_second = everything()
    assert at_first != at_second
    for _ in range(2):
        unit.restore(saved)
        assert everything() == at_first
        step(second)
        assert everything() == at_second
    # The same in another instance, from bytes.
    written = unit.fmu.serializeFMUState(saved[0])
    other = units(name)
    other.fmu.setFMUState(other.fmu.deserializeFMUState(written))
    other.time = first
    unit = other
    assert everything() == at_first
    step(second)
    assert everything() == at_second
    # A state of the other side, damaged bytes, a state that was freed.
    stranger = units("rigid" if name != "rigid" else "alone")
    wrong(lambda: stranger.fmu.setFMUState(saved[0]), "no state of this library")
    wrong(lambda: stranger.fmu.setFMUState(stranger.fmu.deserializeFMUState(written)), "another unit")
    for damaged in (written[:40], written[:-3], b"\0" * len(written), written[:18]):
        def take():
            state = other.fmu.deserializeFMUState(damaged)
            other.fmu.setFMUState(state)
        wrong(take)
    assert everything() == at_second
    own = other.fmu.getFMUState()
    freed = ctypes.c_void_p(own.value)
    other.fmu.freeFMUState(own)
    for gone in (freed, ctypes.c_void_p(12345), ctypes.c_void_p()):
        wrong(lambda: other.fmu.setFMUState(gone), "no state of this library, or it was freed")  # noqa: B023


def test_bad_input_is_refused_with_words_and_changes_nothing(units, folder):
    thigh = units("alone")
    reference = {n: v.valueReference for n, v in thigh.variables.items()}
    wrong(lambda: thigh.fmu.doStep(0.0, 1.0), "fmi3DoStep in instantiated; it belongs in step mode")
    wrong(lambda: thigh.fmu.getFloat64([reference["section_force"]], 3), "getting values in instantiated")
    wrong(lambda: thigh.fmu.enterInitializationMode(startTime=math.nan), "finite")
    thigh.initialize(0.0)
    before = {n: bits(thigh.get(n)) for n in ("section_force", "displacement", "activation", "patella.pose")}
    wrong(lambda: thigh.set("activation", [0.1, 1.9, -0.2]), "activation is 1.9 at 2, -0.2 at 3, must be from 0 to 1.8")
    wrong(lambda: thigh.set("activation", [0.1, math.nan, 0.1]), "NaN at 2")
    wrong(lambda: thigh.set("activation", [0.1]), "1 values for 3: activation [3]")
    wrong(lambda: thigh.set("patella.pose", [0, 0, 0, 2.0, 0, 0, 0]), "patella.pose", "length 2, must be 1")
    wrong(lambda: thigh.set("patella.pose", [0, math.inf, 0, 1.0, 0, 0, 0]), "patella.pose is inf at 2, must be finite")
    wrong(lambda: thigh.set("section_force", [1.0, 1.0, 1.0]), "section_force is no input")
    wrong(lambda: thigh.fmu.setFloat64([99999], [0.0]), "there is no variable 99999")
    wrong(lambda: thigh.fmu.getFloat64([reference["lever_arm_known"]], 12), "is a Boolean, not a Float64")
    wrong(lambda: thigh.fmu.getInt32([reference["section_force"]], 3), "nothing of the kind")
    wrong(lambda: thigh.fmu.doStep(0.0, -1.0), "must be above 0")
    wrong(lambda: thigh.fmu.doStep(0.0, math.nan), "must be above 0")
    wrong(lambda: thigh.fmu.doStep(-1.0, 1.0), "the unit is at 0 s; it goes back by fmi3SetFMUState alone")
    wrong(lambda: thigh.fmu.setDebugLogging(True, ["logNothing"]), "there is no category `logNothing`")
    assert {n: bits(thigh.get(n)) for n in before} == before
    rigid = units("rigid")
    rigid.fmu.enterInitializationMode(startTime=100.0)
    wrong(rigid.fmu.exitInitializationMode, "the trial has no frame at 100 s")


def test_resources_of_another_unit_are_refused(folder):
    description = fmpy.read_model_description(str(folder / "rigid.fmu"))
    unzipped = fmpy.extract(str(folder / "alone.fmu"))
    fmu = fmi3.FMU3Slave(guid=description.guid, unzipDirectory=unzipped, modelIdentifier="sartorius_fmi", instanceName="mixed")
    with pytest.raises(Exception, match="instantiate"):
        fmu.instantiate()
    assert any("are not those of this unit" in said for said in SAID), SAID
    with pytest.raises(Exception, match="instantiate"):
        fmu.instantiate(eventModeUsed=True)
    assert any("no event mode" in said for said in SAID), SAID


def test_a_master_looks_on_within_a_step_and_ends_it_early(folder):
    description = fmpy.read_model_description(str(folder / "rigid.fmu"))
    unzipped = fmpy.extract(str(folder / "rigid.fmu"))
    fmu = fmi3.FMU3Slave(guid=description.guid, unzipDirectory=unzipped, modelIdentifier="sartorius_fmi", instanceName="watched")
    seen = []
    frame_time = next(v.valueReference for v in description.modelVariables if v.name == "frame_time")

    def update(environment, now, set_requested, get_allowed, finished, may_return, wants, when):
        seen.append((now, fmu.getFloat64([frame_time], 1)[0], may_return))
        if may_return and len(seen) == 5:
            wants[0] = True
            when[0] = now

    fmu.instantiate(earlyReturnAllowed=True, intermediateUpdate=update)
    experiment = description.defaultExperiment
    start, stop, dt = (float(v) for v in (experiment.startTime, experiment.stopTime, experiment.stepSize))
    fmu.enterInitializationMode(startTime=start)
    fmu.exitInitializationMode()
    _, _, early, last = fmu.doStep(start, stop - start)
    assert early and len(seen) == 5 and math.isclose(last, start + 5 * dt, rel_tol=1e-9)
    assert all(abs(now - told) < 1e-9 for now, told, _ in seen)
    _, _, early, last = fmu.doStep(last, stop - last)
    assert not early and last == stop and seen[-1][2] is False
    fmu.freeInstance()


def test_going_back_and_a_step_of_the_rigid_leg_take_less_than_100_microseconds(units):
    rigid = units("rigid")
    times, dt = gait_steps(rigid)
    start = min(times.values()) - 0.25 * dt
    rigid.initialize(start)
    state, fmu = rigid.save()[0], rigid.fmu
    best = math.inf
    for _ in range(20):
        clock = time.perf_counter()
        for _ in range(100):
            fmu.setFMUState(state)
            fmu.doStep(start, 0.25 * dt)
        best = min(best, (time.perf_counter() - clock) / 100)
    print(f"rollback and step: {1e6 * best:.1f} microseconds")
    assert best < 100e-6


@pytest.mark.parametrize("name", ["rigid", "alone"])
def test_1100_instances_leave_nothing(folder, name):
    description = fmpy.read_model_description(str(folder / f"{name}.fmu"))
    unzipped = fmpy.extract(str(folder / f"{name}.fmu"))
    before = tree(unzipped)
    handles = lambda: len(os.listdir("/proc/self/fd")) if sys.platform == "linux" else 0  # noqa: E731

    def memory():
        gc.collect()
        return int(open("/proc/self/statm").read().split()[1]) * 4096 / 2**20 if sys.platform == "linux" else 0

    fmu = fmi3.FMU3Slave(guid=description.guid, unzipDirectory=unzipped, modelIdentifier="sartorius_fmi", instanceName="many")
    at = []
    for k in range(1100):
        fmu.instantiate()
        fmu.enterInitializationMode(startTime=0.0)
        fmu.exitInitializationMode()
        state = fmu.getFMUState()
        fmu.setFMUState(state)
        # Half of the states are left to the unit, which frees them with the instance.
        if k % 2:
            fmu.freeFMUState(state)
        fmu.fmi3FreeInstance(fmu.component)
        if k in (99, 1099):
            at.append((handles(), memory()))
    (handles_before, memory_before), (handles_after, memory_after) = at
    print(f"{name}: {memory_before:.1f} MiB after 100, {memory_after:.1f} MiB after 1100, {handles_after} handles")
    assert handles_after == handles_before
    assert memory_after - memory_before < 2.0
    assert tree(unzipped) == before


def tree(folder):
    """Every file with its hash and time."""
    files = sorted(p for p in pathlib.Path(folder).rglob("*") if p.is_file())
    return [(str(p), hashlib.sha256(p.read_bytes()).hexdigest(), p.stat().st_mtime_ns) for p in files]


def table(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_one_way_in_fmpy_is_compare(folder, units, tmp_path):
    sartorius("compare", folder / "three.toml", "--out", tmp_path / "compare")
    rows = {(r["step"], r["muscle"]): r for r in table(tmp_path / "compare/comparison.csv")}
    for name, column in [("contact", "fe_contact_N"), ("alone", "fe_no_contact_N")]:
        rigid, thigh = units("rigid"), units(name)
        times, results, _ = couple(rigid, thigh)
        for step, result in zip(times, results):
            for m, muscle in enumerate(thigh.names("muscles")):
                row = rows[step, muscle]
                places = len(row[column].partition(".")[2])
                # As many digits as the table has; to the last bit: tests/session.rs.
                assert f"{result['section_force_N'][m]:.{places}f}" == row[column], (name, step, muscle)
                assert f"{result['rigid_N'][m]:.{places}f}" == row["rigid_N"], (name, step, muscle)


@pytest.mark.parametrize("scheme", ["iqn-ils", "aitken", "relaxation"])
def test_two_way_in_fmpy_is_compare_two_way(folder, units, tmp_path, scheme):
    sartorius("compare", folder / "three.toml", f"--two-way={scheme}", "--out", tmp_path / "compare")
    script = [sys.executable, ROOT / "coupling/fmi/examples/couple.py", folder / "rigid.fmu", folder / "alone.fmu", "--two-way", scheme, "--out", tmp_path / "couple"]
    done = subprocess.run(list(map(str, script)), capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    passes = table(tmp_path / "compare/passes.csv")
    log = (tmp_path / "couple/couple-convergence.log").read_text().splitlines()
    assert len(log) == len(passes), (log, passes)
    iterations = (tmp_path / "couple/couple-iterations.log").read_text().split("\n")
    assert iterations[0].split()[:4] == ["TimeWindow", "TotalIterations", "Iterations", "Convergence"]
    assert int(iterations[1].split()[1]) == len(passes) - 1
    theirs, ours = table(tmp_path / "compare/capacities.csv"), table(tmp_path / "couple/capacities.csv")
    assert [(r["step"], r["muscle"]) for r in theirs] == [(r["step"], r["muscle"]) for r in ours]
    largest = 0.0
    for there, here in zip(theirs, ours):
        # Bounds, times and angles follow from these and the rigid side.
        assert list(here) == list(there)[:9]
        for column in list(here)[2:]:
            a, b = float(there[column]), float(here[column])
            largest = max(largest, abs(a - b) / max(abs(a), 1e-3))
    print(f"{scheme}: {len(passes)} passes, capacities differ by {largest:.1e}")
    assert largest < 1e-9
