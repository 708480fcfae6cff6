"""Reads motions and storage files as OpenSim does, and says where the bodies of a model are then: JSON on standard output.

    python3 read_in_opensim.py MODEL.osim MOTION.mot... [-- STORAGE.sto...]
"""

import json
import sys

import opensim

opensim.Logger.setLevelString("Off")
model = opensim.Model(sys.argv[1])
state = model.initSystem()
coordinates = model.getCoordinateSet()
split = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)


def labels(storage):
    found = storage.getColumnLabels()
    return [found.get(i) for i in range(found.getSize())]


def places(file):
    storage = opensim.Storage(file)
    assert storage.isInDegrees(), file
    model.getSimbodyEngine().convertDegreesToRadians(storage)
    names = labels(storage)[1:]
    assert all(coordinates.contains(name) for name in names), names
    frames = []
    for row in range(storage.getSize()):
        values = storage.getStateVector(row).getData()
        for i, name in enumerate(names):
            coordinates.get(name).setValue(state, values.get(i), False)
        model.realizePosition(state)
        bodies = {}
        for body in model.getBodyList():
            transform = body.getTransformInGround(state)
            R, p = transform.R(), transform.p()
            bodies[body.getName()] = [[R.get(i, j) for j in range(3)] for i in range(3)] + [[p[i] for i in range(3)]]
        frames.append({"time": storage.getStateVector(row).getTime(), "bodies": bodies})
    return {"names": names, "frames": frames}


def table(file):
    storage = opensim.Storage(file)
    names = labels(storage)[1:]
    muscles = [m.getName() for m in model.getMuscles()]
    return {"rows": storage.getSize(), "unknown": [n for n in names if n not in muscles], "names": names}


answer = {
    "version": opensim.GetVersion(),
    "coordinates": [c.getName() for c in coordinates],
    "motions": [places(file) for file in sys.argv[2:split]],
    "tables": [table(file) for file in sys.argv[split + 1 :]],
}
print("JSON" + json.dumps(answer))
