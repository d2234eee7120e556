"""The room that a depth frame shows, as contact for the bodies of any simulator. The examples beside this file use it.

A stiff force that a simulator adds as it was before a step makes energy out of nothing. So the wrench here is that of
the end of the step, linearized where the body would be without contact:

    w = F - (h K + D) v',   v' = v + h A w   =>   (1 + h (h K + D) A) w = F - D v

F and K are wrench and stiffness of Palpate at the pose after the step without contact, v the twist there, A the inverse
inertia that the body opposes to a wrench, h the step. D damps and holds: along the normal as a material that settles
after `settling` seconds, across it by Coulomb friction that creeps with `CREEP` instead of standing still.

Frames: W has z up and the table at z = 0; B is the body, its origin at its center of mass. Wrenches and twists have
forces and velocities first, are in W and about B.
"""

import threading

import numpy as np

import palpate

STEP = 0.001    # s
GRAVITY = 9.81  # m/s2
CREEP = 1e-6    # m/s: below this, friction is proportional to the slip
MASS, HALF_SIDES = 1.0, np.array([0.03, 0.03, 0.02])  # kg and m, of the peg of all examples
ROUNDS = 12     # of the slip, which friction depends on


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def turn(a):
    """Rotation matrix of a rotation vector, rad."""
    angle = np.linalg.norm(a)
    if angle < 1e-12:
        return np.eye(3) + skew(a)
    k = skew(a / angle)
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def moved(X, shift):
    """The pose after a small displacement (translation, rotation) in W."""
    Y = np.array(X, float)
    Y[:3, 3] += shift[:3]
    Y[:3, :3] = turn(shift[3:]) @ Y[:3, :3]
    return Y


def at(p):
    """Matrix from a twist about B to the twist at B + p; its transpose takes wrenches back."""
    G = np.eye(6)
    G[:3, 3:] = -skew(p)
    return G


class Room:
    """What a camera sees, for one kind of body. stiffness: N/m3. blend: s from one frame to the next."""

    def __init__(self, tool, surface, *, stiffness=1e7, friction=0.5, settling=0.006, blend=1 / 30):
        self.contact, self.center, self.corners = palpate.Contact(tool), tool.center_of_mass, tool.mesh[0]
        self.stiffness, self.friction, self.settling, self.blend = stiffness, friction, settling, blend
        self.frames = surface, surface, -np.inf  # old, new, and since when; set at once, for a thread that shows frames

    def show(self, surface, time):
        """The next frame, which fades in from this time on."""
        self.frames = self.frames[1], surface, time

    def felt(self, X_WB, time=np.inf):
        """Wrench (6,), stiffness (6, 6) and potential energy (J) of the contact at a pose (4, 4)."""
        old, new, since = self.frames
        share = 1.0 if time - since >= self.blend else max(0.0, (time - since) / self.blend)
        F, K, energy = np.zeros(6), np.zeros((6, 6)), 0.0
        for surface, part in ((new, share), (old, 1 - share)):
            if part == 0:
                continue
            result = self.contact.measure(surface, X_WB, stiffness=True)
            F += part * np.concatenate([result.force, result.torque])
            K += part * result.stiffness
            energy += part * result.potential
        to_center = at(X_WB[:3, :3] @ self.center)
        return (self.stiffness * to_center.T @ F, self.stiffness * to_center.T @ K @ to_center,
                self.stiffness * energy)

    def wrench(self, X_WB, v, A, h=STEP, time=np.inf):
        """Wrench for a step of h. v: the twist after the step without contact. A: (6, 6), so that it changes v by h A w."""
        X = moved(X_WB, h * v)
        F, K, _ = self.felt(X, time)
        load = np.linalg.norm(F[:3])
        if load == 0:
            return np.zeros(6)
        n = F[:3] / load
        # The place that presses: on the axis of the wrench, at the height of the lowest corner.
        press = at(np.cross(n, F[3:]) / load + n * (self.corners @ X[:3, :3].T @ n).min())
        across = np.eye(3) - np.outer(n, n)
        hardness = max(n @ K[:3, :3] @ n, 1e-9)
        radius = np.sqrt(max(np.trace(K[3:, 3:]), 0) / hardness)  # rms, of the area that presses
        w, after = F, v
        for _ in range(ROUNDS):
            slip = press @ after
            hold = self.friction * load
            along = hold / max(np.linalg.norm(across @ slip[:3]), CREEP)
            spin = hold * radius / max(abs(n @ slip[3:]), CREEP / max(radius, 1e-6))
            D = np.zeros((6, 6))
            D[:3, :3] = self.settling * hardness * np.outer(n, n) + along * across
            D[3:, 3:] = self.settling * hardness * radius**2 / 2 * across + spin * np.outer(n, n)
            D = press.T @ D @ press
            w = np.linalg.solve(np.eye(6) + h * (h * K + D) @ A, F - D @ v)
            load, before, after = n @ w[:3], after, v + h * A @ w
            if load <= 0:
                return np.zeros(6)
            if abs(after - before).max() < 1e-12:
                break
        return w


def watch(frames, sensor, rooms, now):
    """Shows each of the frames (time, depth, pose) to the rooms when it comes, in a thread of its own. now: simulated time, s."""
    def look():
        for _, depth, _ in frames:
            surface = sensor.update(depth)
            for room in rooms:
                room.show(surface, now())

    threading.Thread(target=look, daemon=True).start()


def free_body(R, inertia):
    """Inverse inertia (6, 6) of a free body of MASS. inertia: (3,) about its axes, kg m2."""
    A = np.eye(6) / MASS
    A[3:, 3:] = R / inertia @ R.T
    return A


def peg_inertia():
    return MASS / 3 * (HALF_SIDES @ HALF_SIDES - HALF_SIDES**2)


def box(half):
    """Vertices and triangles of a box."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    return corners, np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                              [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])


def peg(spheres=500):
    return palpate.pack(*box(HALF_SIDES), spheres)


def looking(eye, at_point):
    """X_WC of a camera: z towards a point, y down."""
    z = (at_point - eye) / np.linalg.norm(at_point - eye)
    x = np.cross(z, [0, 0, 1])
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), eye
    return X


def table(tilt=0.0, width=320, height=240):
    """A depth image (m) of a table with a block on it, seen from aslant, and its camera. tilt: rad, of the table about y."""
    X_WC, f = looking(np.array([0.0, -0.55, 0.6]), np.zeros(3)), 0.9 * width
    v, u = np.mgrid[:height, :width]
    rays = np.stack([(u - (width - 1) / 2) / f, (v - (height - 1) / 2) / f, np.ones(u.shape)], axis=-1) @ X_WC[:3, :3].T
    eye, normal = X_WC[:3, 3], np.array([np.sin(tilt), 0, np.cos(tilt)])
    depth = -(normal @ eye) / (rays @ normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.stack([[0.12, 0.02, -0.01], [0.2, 0.14, 0.06]]) - eye) / rays[..., None, :]
    near, far = np.nanmin(ends, axis=-2).max(axis=-1), np.nanmax(ends, axis=-2).min(axis=-1)
    depth = np.where((near < far) & (near > 0), np.minimum(near, depth), depth)
    return depth.astype(np.float32), palpate.Camera(width, height, f, f, (width - 1) / 2, (height - 1) / 2, pose=X_WC)


def on_its_table(depth, width, height, fx, fy, cx, cy, unit=0.001, seed=0):
    """The camera of a recorded image, in a W whose z = 0 is the largest plane in it and whose origin is an empty spot there."""
    lens = (width, height, fx, fy, cx, cy)
    points = np.asarray(palpate.Sensor(palpate.Camera(*lens, unit=unit)).update(depth).points, float)
    cloud, random = points[::4, ::4].reshape(-1, 3), np.random.default_rng(seed)
    cloud, best = cloud[np.isfinite(cloud).all(axis=1)], None
    for _ in range(300):
        a, b, c = cloud[random.choice(len(cloud), 3, replace=False)]
        n = np.cross(b - a, c - a)
        if np.linalg.norm(n) > 1e-6:
            inside = abs((cloud - a) @ n) < 0.006 * np.linalg.norm(n)
            best = inside if best is None or inside.sum() > best.sum() else best
    for _ in range(5):
        middle = cloud[best].mean(axis=0)
        n = np.linalg.svd(cloud[best] - middle, full_matrices=False)[2][2]
        best = abs((cloud - middle) @ n) < 0.004
    n *= -np.sign(n @ middle)  # towards the camera
    flat = np.where(abs((points - middle) @ n) < 0.004, 1.0, 0.0)
    sums, half = np.pad(flat, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1), 60
    room = sums[2 * half:, 2 * half:] - sums[2 * half:, :-2 * half] - sums[:-2 * half, 2 * half:] + sums[:-2 * half, :-2 * half]
    v, u = np.unravel_index(np.argmax(room), room.shape)
    ray = np.array([(u + half - cx) / fx, (v + half - cy) / fy, 1])
    spot = ray * (middle @ n) / (ray @ n)
    x = np.cross([0, 1.0, 0], n) / np.linalg.norm(np.cross([0, 1.0, 0], n))
    X_WC = np.eye(4)
    X_WC[:3, :3] = np.stack([x, np.cross(n, x), n])
    X_WC[:3, 3] = -X_WC[:3, :3] @ spot
    return palpate.Camera(*lens, unit=unit, pose=X_WC)
