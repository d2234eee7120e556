"""Checks of the results of the guides' examples, beyond that their commands run."""
import csv
import json
import re


def summary(folder, run):
    return json.loads((folder / run / "summary.json").read_text())


def column(folder, run, name):
    with open(folder / run / "wrench.csv", encoding="ascii") as file:
        return [float(row[name]) for row in csv.DictReader(file)]


def page(folder, run):
    """The data inside a report; None in a build without pages."""
    path = folder / run / "report.html"
    found = path.exists() and re.search('<script type="application/json" id="data">(.*?)</script>', path.read_text(), re.S)
    return json.loads(found.group(1)) if found else None


def moving_bodies(folder, said):
    """The stylus pushes the block over the table, against its friction, and touches nothing else."""
    in_objects, all_volume = column(folder, "pushed", "objects_volume_m3"), column(folder, "pushed", "volume_m3")
    assert in_objects == all_volume and max(in_objects[:900]) == 0
    half = column(folder, "pushed", "force_x_N")[1500:2500]
    assert all(abs(-force - 0.5 * 0.3 * 9.81) < 0.3 for force in half), (min(half), max(half))
    assert "unobserved space" not in said
    report = page(folder, "pushed")
    if report:
        [block] = report["moment"]["objects"]
        assert block["mesh"] and block["X_WB"][0] > -0.22, block["X_WB"]


def memory(folder, _):
    """The same run is pushed out of what occludes the tool, and with memory it is not."""
    without, remembered = summary(folder, "forgotten")["peaks"], summary(folder, "remembered")["peaks"]
    assert without["fraction"] > 0.99 and abs(without["force_N"] - 87) < 2, without
    assert remembered["force_N"] == 0, remembered


def several_cameras(folder, said):
    """The second camera sees what is a guess for the first one, and the report has both."""
    assert "unobserved space" not in said
    one, two = (summary(folder, run)["peaks"] for run in ("one-camera", "two-cameras"))
    assert abs(two["fraction"] - 0.12) < 0.01 and two["unseen"] == 0, two
    assert abs(one["fraction"] - 0.47) < 0.01, one
    report = page(folder, "two-cameras")
    if report:
        assert [len(report[part]["cameras"]) for part in ("summary", "moment")] == [2, 2]


def materials(folder, _):
    """The stylus touches the block, which is as smooth as ice."""
    ice = summary(folder, "ice")
    assert ice["peaks"]["objects_volume_m3"] > 0 and ice["objects"][0]["friction"] == 0.1, ice["objects"]


SUBJECTS = {"docs/guide/moving-bodies.md": moving_bodies, "docs/guide/memory.md": memory,
            "docs/guide/several-cameras.md": several_cameras, "docs/guide/materials.md": materials}
