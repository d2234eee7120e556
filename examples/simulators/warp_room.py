"""The equation of room.py as kernels of Warp, for many free bodies at once on a CPU or a GPU; all in double precision.

`predict` says where bodies would be after a step without contact, as the camera C sees them. There, Palpate measures.
`press` solves for the wrench in W.
"""

import warp as wp
from room import CREEP, MASS, ROUNDS, STEP

d = wp.float64
vec6, mat66 = wp.spatial_vectord, wp.spatial_matrixd
wp.set_module_options({"enable_backward": False})
H, M_PEG, SLOW, TINY = wp.constant(d(STEP)), wp.constant(d(MASS)), wp.constant(d(CREEP)), wp.constant(d(1e-9))
CONVERGED = wp.constant(d(1e-24))  # m2/s2: square of the change at which room.py stops


def compile_for(device):
    """Warp's compiler for CPUs takes minutes over unrolled matrices of 6 x 6; on GPUs they stay in registers. Before the first launch."""
    if device == "cpu":
        wp.set_module_options({"max_unroll": 1, "optimization_level": 1})


@wp.kernel
def predict(q: wp.array(dtype=wp.transform), qd: wp.array(dtype=wp.spatial_vector), gravity: wp.vec3d,
            X_WC: wp.transformd, poses: wp.array(dtype=d, ndim=2), free: wp.array(dtype=vec6)):
    """Computes poses X_CB (P, 7) and twists in W after a step without contact."""
    i = wp.tid()
    p, r = wp.transform_get_translation(q[i]), wp.transform_get_rotation(q[i])
    v, w = wp.vec3d(wp.spatial_top(qd[i])) + H * gravity, wp.vec3d(wp.spatial_bottom(qd[i]))
    turned = wp.normalize(wp.quatd(d(r[0]), d(r[1]), d(r[2]), d(r[3])))
    turned = wp.normalize(turned + wp.quatd(w[0], w[1], w[2], d(0.0)) * turned * (d(0.5) * H))
    X_CB = wp.transform_inverse(X_WC) * wp.transformd(wp.vec3d(p) + H * v, turned)
    for k in range(7):
        poses[i, k] = X_CB[k]
    free[i] = vec6(v[0], v[1], v[2], w[0], w[1], w[2])


@wp.func
def solve(A: mat66, b: vec6):
    """Solves for a symmetric positive matrix, by elimination."""
    for k in range(6):
        for i in range(k + 1, 6):
            f = A[i, k] / A[k, k]
            for j in range(k, 6):
                A[i, j] = A[i, j] - f * A[k, j]
            b[i] = b[i] - f * b[k]
    for m in range(6):
        k = 5 - m
        for j in range(k + 1, 6):
            b[k] = b[k] - A[k, j] * b[j]
        b[k] = b[k] / A[k, k]
    return b


@wp.func
def blocks(a: wp.mat33d, b: wp.mat33d, c: wp.mat33d):
    """Returns the matrix with a and c on its diagonal and b at the upper right."""
    made = mat66()
    for i in range(3):
        for j in range(3):
            made[i, j] = a[i, j]
            made[i, j + 3] = b[i, j]
            made[i + 3, j + 3] = c[i, j]
    return made


@wp.kernel
def press(poses: wp.array(dtype=d, ndim=2), free: wp.array(dtype=vec6), force: wp.array(dtype=wp.vec3d),
          torque: wp.array(dtype=wp.vec3d), stiffness: wp.array(dtype=mat66), X_WC: wp.transformd, inertia: wp.vec3d,
          half: wp.vec3d, center: wp.vec3d, law: wp.vec3d, body_f: wp.array(dtype=wp.spatial_vector)):
    """Computes the wrench of Room.wrench for a box, of what was measured in C. law: stiffness in N/m3, friction, settling in s."""
    i = wp.tid()
    body_f[i] = wp.spatial_vector()
    q_WC = wp.transform_get_rotation(X_WC)
    f = law[0] * wp.quat_rotate(q_WC, force[i])
    load = wp.length(f)
    if load > d(0.0):
        r, n = q_WC * wp.quatd(poses[i, 3], poses[i, 4], poses[i, 5], poses[i, 6]), f / load
        R, c, one, none = wp.quat_to_matrix(r), wp.quat_rotate(r, center), wp.identity(3, dtype=d), wp.mat33d()
        t = law[0] * wp.quat_rotate(q_WC, torque[i]) + wp.cross(c, f)
        low = wp.quat_rotate_inv(r, n)
        p = wp.cross(n, t) / load - n * (wp.abs(low[0]) * half[0] + wp.abs(low[1]) * half[1] + wp.abs(low[2]) * half[2])
        nn = wp.outer(n, n)
        G, S = blocks(one, -wp.skew(p), one), blocks(one, -wp.skew(c), one)
        M = blocks(M_PEG * one, none, R * wp.diag(inertia) * wp.transpose(R))
        R_CW = wp.transpose(wp.quat_to_matrix(q_WC))
        S = blocks(R_CW, none, R_CW) * S
        K = law[0] * (wp.transpose(S) * stiffness[i] * S)
        hardness = wp.max(n[0] * (K[0, 0] * n[0] + K[0, 1] * n[1] + K[0, 2] * n[2]) +
                          n[1] * (K[1, 0] * n[0] + K[1, 1] * n[1] + K[1, 2] * n[2]) +
                          n[2] * (K[2, 0] * n[0] + K[2, 1] * n[1] + K[2, 2] * n[2]), TINY)
        radius = wp.sqrt(wp.max(K[3, 3] + K[4, 4] + K[5, 5], d(0.0)) / hardness)
        F, v = vec6(f[0], f[1], f[2], t[0], t[1], t[2]), d(1.0) * free[i]
        after, w = d(1.0) * v, d(1.0) * F
        for _ in range(wp.static(ROUNDS)):
            if load > d(0.0):
                s = G * after
                sv, sw = wp.vec3d(s[0], s[1], s[2]), wp.vec3d(s[3], s[4], s[5])
                along = law[1] * load / wp.max(wp.length(sv - n * wp.dot(n, sv)), SLOW)
                spin = law[1] * load * radius / wp.max(wp.abs(wp.dot(n, sw)), SLOW / wp.max(radius, d(1e-6)))
                rock = law[2] * hardness * radius * radius * d(0.5)
                D = blocks(law[2] * hardness * nn + along * (one - nn), none, rock * (one - nn) + spin * nn)
                D = wp.transpose(G) * D * G
                gained = solve(M + H * (H * K + D), H * (F - D * v))
                change = v + gained - after
                w, after = (M * gained) / H, v + gained
                if wp.dot(change, change) < CONVERGED:
                    break
                load = n[0] * w[0] + n[1] * w[1] + n[2] * w[2]
        if load > d(0.0):
            body_f[i] = wp.spatial_vector(float(w[0]), float(w[1]), float(w[2]), float(w[3]), float(w[4]), float(w[5]))
