"""The obvious answer to a contact query: every point against every sphere, every sphere against
every boundary sphere, in plain Python. Written from the formulas, shares nothing with the program."""

import math


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def sub(a, b):
    return [a[0] - b[0], a[1] - b[1], a[2] - b[2]]


def add(a, b):
    return [a[0] + b[0], a[1] + b[1], a[2] + b[2]]


def times(a, s):
    return [a[0] * s, a[1] * s, a[2] * s]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def rotate(q, v):
    """Rotates v by the unit quaternion x, y, z, w."""
    axis, w = q[:3], q[3]
    t = times(cross(axis, v), 2)
    return add(v, add(times(t, w), cross(axis, t)))


def transform(pose, p):
    return add(rotate(pose[3:], p), pose[:3])


def cap(r, d):
    """Volume of a ball behind a plane, its center at signed distance d in front (Alg. 3.1)."""
    h = min(max(r - d, 0.0), 2 * r)
    return math.pi / 3 * h * h * (3 * r - h)


def center_of_mass(spheres):
    total = sum(s[3] ** 3 for s in spheres)
    return [sum(s[axis] * s[3] ** 3 for s in spheres) / total for axis in range(3)]


def reference_of_spheres(spheres, edges, centers, planes, counts):
    """Boundary sphere that reaches each sphere over the fewest edges, round by round (Alg. 3.5/3.6)."""
    neighbors = [[] for _ in spheres]
    for a, b in edges:
        neighbors[a].append(b)
        neighbors[b].append(a)
    reference = {b: b for b in planes}
    length = {b: 0.0 for b in planes}
    frontier = list(planes)
    while frontier:
        reached = {}
        for i in frontier:
            normal = planes[reference[i]][1]
            for j in neighbors[i]:
                step = sub(centers[j], centers[i])
                if j in reference or counts[j] > 0 or dot(step, normal) >= 0:
                    continue
                key = (length[i] + math.sqrt(dot(step, step)), reference[i])
                reached[j] = min(reached.get(j, key), key)
        for j, (path, b) in reached.items():
            length[j], reference[j] = path, b
        frontier = list(reached)
    return reference


def measure(spheres, edges, cloud, pose, method, priority="distance", inside="full"):
    """(volume, force, torque, number of boundary spheres, number of points)."""
    centers = [transform(pose, s[:3]) for s in spheres]
    origin = transform(pose, center_of_mass(spheres))
    radii = [s[3] for s in spheres]
    counts = [0] * len(spheres)
    planes = {}
    for s, (c, r) in enumerate(zip(centers, radii)):
        touching = [p for p in cloud if dot(sub(p, c), sub(p, c)) <= r * r]
        counts[s] = len(touching)
        if not touching:
            continue
        mean = times([sum(p[k] for p in touching) for k in range(3)], 1 / len(touching))
        normal = [sum(p[k] for p in touching) for k in range(3, 6)]
        planes[s] = (mean, times(normal, 1 / math.sqrt(dot(normal, normal))))

    volume, force, torque = 0.0, [0.0] * 3, [0.0] * 3

    def act(s, v, f):
        nonlocal volume, force, torque
        volume += v
        force = add(force, f)
        torque = add(torque, cross(sub(centers[s], origin), f))

    def cut(s, plane):
        p, n = plane
        return cap(radii[s], dot(n, sub(centers[s], p)))

    for s, plane in planes.items():
        v = cut(s, plane)
        act(s, v, times(plane[1], v))
    if method == "graph":
        reference = reference_of_spheres(spheres, edges, centers, planes, counts)
        for s, b in reference.items():
            if s in planes:
                continue
            v = cut(s, planes[b]) if inside == "cap" else cap(radii[s], -radii[s])
            act(s, v, times(planes[b][1], v))
    elif planes:
        for s in range(len(spheres)):
            if s in planes:
                continue

            def weight(b):
                if priority == "count":
                    return counts[b]
                d = sub(centers[b], centers[s])
                return 1 / math.sqrt(dot(d, d))

            if method == "weighted":
                donors = [(weight(b), b) for b in planes]
            else:
                donors = [(1.0, max(planes, key=lambda b: (weight(b), -b)))]
            total = sum(w for w, _ in donors)
            v = sum(w * cut(s, planes[b]) for w, b in donors) / total
            f = [sum(w * cut(s, planes[b]) * planes[b][1][k] for w, b in donors) / total
                 for k in range(3)]
            act(s, v, f)
    return volume, force, torque, len(planes), sum(counts)
