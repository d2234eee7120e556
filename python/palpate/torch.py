"""Differentiable contact for PyTorch: palpate.torch.penetration and palpate.torch.wrench.

Everything is computed in double from the depth field of a surface in host memory, element by
element: the exact derivatives of the field measure, for optimization and learning. For throughput
without derivatives see Contact.measure_batch.
"""

from __future__ import annotations

import weakref
from typing import Any, NamedTuple, Optional, Tuple, Union

import numpy as np

try:
    import torch
except ImportError as error:
    raise ImportError("palpate.torch needs PyTorch: pip install torch") from error

from palpate import _core

__all__ = ["Penetration", "clearance", "penetration", "wrench"]

#: A tool, or a contact with one.
ToolOrContact = Union[_core.Tool, _core.Contact]

_contacts: "weakref.WeakKeyDictionary[_core.Tool, _core.Contact]" = weakref.WeakKeyDictionary()
_differentiated: "weakref.WeakKeyDictionary[_core.Tool, _core.Differentiated]" = weakref.WeakKeyDictionary()


class Penetration(NamedTuple):
    """Result of `penetration`: (P,) each."""

    #: Volume of the tool inside the scene, m3.
    volume: torch.Tensor
    #: Potential, m4; its negative gradient by the pose is the wrench.
    potential: torch.Tensor


def _contact_of(tool: ToolOrContact) -> _core.Contact:
    if isinstance(tool, _core.Contact):
        return tool
    contact = _contacts.get(tool)
    if contact is None:
        contact = _contacts[tool] = _core.Contact(tool)
    return contact


def _measure(tool: _core.Tool, surface: Any, poses: torch.Tensor) -> Tuple[Any, ...]:
    if isinstance(surface, _core.Scene) and surface.unseen == "solid" and not surface.bodies and len(surface.cameras) == 1:
        surface = surface.cameras[0]
    if not isinstance(surface, _core.Surface):
        numbers = np.ascontiguousarray(poses.detach().to("cpu", torch.float64).numpy())
        batch = _contact_of(tool).measure_batch(surface, numbers, stiffness=True)
        both = np.concatenate([batch.force, batch.torque], 1)
        found = (batch.volume, batch.potential, both, batch.stiffness)
        volume, potential, wrench_W, stiffness = (torch.from_numpy(np.array(each)) for each in found)
        return volume, potential, None, wrench_W, stiffness
    by_definition = _differentiated.get(tool)
    if by_definition is None:
        by_definition = _differentiated[tool] = _core.Differentiated(tool)
    given = np.ascontiguousarray(poses.detach().to("cpu", torch.float64).numpy())
    return tuple(torch.from_numpy(array) for array in by_definition(surface, given))


def _motions(tool: _core.Tool, poses: torch.Tensor) -> torch.Tensor:
    """Jacobian of the tool's motion by the numbers of its pose: (P, 6, K), K = 7 or 16.

    Rows: shift of its center of mass, and rotation about it, both in W.
    """
    num = poses.shape[0]
    p_TC = torch.as_tensor(np.array(tool.center_of_mass), dtype=poses.dtype)
    eye = torch.eye(3, dtype=poses.dtype)
    if poses.ndim == 2:
        q = poses[:, 3:]
        x, y, z, w = q.unbind(1)
        # turn = 2 vec(dq q*) / |q|^2, for any length of q
        turn = torch.stack(
            [
                torch.stack([w, -z, y, -x], 1),
                torch.stack([z, w, -x, -y], 1),
                torch.stack([-y, x, w, -z], 1),
            ],
            1,
        ) * (2 / (q * q).sum(1))[:, None, None]
        lever = _rotated(q, p_TC)
        shift = _cross_matrix(lever).transpose(1, 2) @ turn
        top = torch.cat([eye.expand(num, 3, 3), shift], 2)
        bottom = torch.cat([torch.zeros(num, 3, 3, dtype=poses.dtype), turn], 2)
        return torch.cat([top, bottom], 1)
    R = poses[:, :3, :3]
    motions = torch.zeros(num, 6, 4, 4, dtype=poses.dtype)
    # turn = vec of the antisymmetric part of dR R^T, for changes that leave R a rotation
    for k, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        motions[:, 3 + k, i, :3] = R[:, j] / 2
        motions[:, 3 + k, j, :3] = -R[:, i] / 2
    lever = R @ p_TC
    turned = motions[:, 3:].reshape(num, 3, 16)
    motions[:, :3] = (_cross_matrix(lever).transpose(1, 2) @ turned).reshape(num, 3, 4, 4)
    for k in range(3):
        motions[:, k, k, 3] += 1
    return motions.reshape(num, 6, 16)


def _rotated(q: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    unit = q / q.norm(dim=1, keepdim=True)
    axis, w = unit[:, :3], unit[:, 3:]
    fixed = v.expand(q.shape[0], 3)
    once = torch.linalg.cross(axis, fixed)
    return fixed + 2 * (w * once + torch.linalg.cross(axis, once))


def _cross_matrix(v: torch.Tensor) -> torch.Tensor:
    """Returns [v] with [v] a = v x a: (P, 3, 3)."""
    x, y, z = v.unbind(1)
    zero = torch.zeros_like(x)
    rows = [torch.stack(row, 1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return torch.stack(rows, 1)


class _Wrench(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, poses: torch.Tensor, tool: _core.Tool, surface: Any) -> torch.Tensor:
        *_, wrench_W, stiffness = _measure(tool, surface, poses)
        ctx.tool, ctx.stiffness = tool, stiffness
        ctx.save_for_backward(poses)
        return wrench_W.to(poses)

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, by_wrench: torch.Tensor) -> Tuple[Any, ...]:
        (poses,) = ctx.saved_tensors
        motions = _motions(ctx.tool, poses.detach().to("cpu", torch.float64))
        by_motion = -(by_wrench.to("cpu", torch.float64)[:, None] @ ctx.stiffness)
        return (by_motion @ motions).reshape(poses.shape).to(poses), None, None


class _Penetration(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, poses: torch.Tensor, tool: _core.Tool, surface: Any
    ) -> Tuple[torch.Tensor, torch.Tensor]:
        volume, potential, volume_gradient, *_ = _measure(tool, surface, poses)
        ctx.tool, ctx.surface, ctx.volume_gradient = tool, surface, volume_gradient
        ctx.save_for_backward(poses)
        volume = volume.to(poses)
        if volume_gradient is None:
            ctx.mark_non_differentiable(volume)
        return volume, potential.to(poses)

    @staticmethod
    def backward(ctx: Any, by_volume: torch.Tensor, by_potential: torch.Tensor) -> Tuple[Any, ...]:
        (poses,) = ctx.saved_tensors
        inside = poses.to("cpu", torch.float64)
        # The wrench is differentiable, and so is this gradient.
        wrench_W = _Wrench.apply(inside, ctx.tool, ctx.surface)
        by_motion = -by_potential.to(wrench_W)[:, None] * wrench_W
        if ctx.volume_gradient is not None:
            by_motion = by_motion + by_volume.to(wrench_W)[:, None] * ctx.volume_gradient
        gradient = (by_motion[:, None] @ _motions(ctx.tool, inside)).reshape(poses.shape)
        return gradient.to(poses), None, None


def _checked(poses: torch.Tensor) -> torch.Tensor:
    if not poses.is_floating_point():
        raise ValueError(f"poses: numbers of type {poses.dtype} have no gradient; give float64")
    shape = tuple(poses.shape)
    if len(shape) not in (2, 3) or shape[1:] not in ((7,), (4, 4)):
        raise ValueError(f"poses: shape {shape} is not (P, 4, 4) or (P, 7)")
    return poses


def _only_tool(tool: ToolOrContact) -> _core.Tool:
    if isinstance(tool, _core.Tool):
        return tool
    if len(tool.tools) > 1:
        raise ValueError("tool: penetration takes one tool at a time, not a contact with several")
    return tool.tool


def penetration(tool: ToolOrContact, scene: Any, poses: torch.Tensor) -> Penetration:
    """Volume (P,) m3 and potential (P,) m4 of the tool at poses X_WT, differentiable by the poses.

    scene: a Surface, Body or Scene in host memory. poses: (P, 7) tx ty tz qx qy qz qw, with
    quaternions of any length, or (P, 4, 4); results are on their device. The gradient of the
    potential is exactly minus the wrench, and its second derivative the stiffness. With one camera,
    the gradient of the volume is exact, too, but has no second derivative; with several cameras or
    bodies the volume has no gradient. For (P, 4, 4) it is the gradient along rotations.
    """
    volume, potential = _Penetration.apply(_checked(poses), _only_tool(tool), scene)  # type: ignore[no-untyped-call]
    return Penetration(volume, potential)


def clearance(
    tool: ToolOrContact,
    scene: Any,
    poses: torch.Tensor,
    *,
    limit: float = 0.1,
    tool_of_pose: Optional[np.ndarray] = None,
) -> torch.Tensor:
    """Least distance (P,) m of the tool to the scene, see Batch.clearance, differentiable by the poses.

    tool: a tool, or a contact with one or several, of which tool_of_pose (P,) are the indices. poses:
    as in `penetration`. The gradient is exact for the nearest sphere and what it is near to; where
    that changes the clearance has a kink. Second derivatives are those of a sphere before a plane.
    Beyond `limit` (m) the clearance is constant.
    """
    contact = _contact_of(tool)
    numbers = np.ascontiguousarray(_checked(poses).detach().to("cpu", torch.float64).numpy())
    batch = contact.measure_batch(scene, numbers, clearance=True, limit=limit, tool_of_pose=tool_of_pose)
    tools = contact.tools
    which = np.zeros(len(numbers), int) if tool_of_pose is None else np.asarray(tool_of_pose)
    spheres = np.array([tools[k].spheres[max(i, 0), :3] for k, i in zip(which, batch.nearest)]).reshape(-1, 3)
    c_T = torch.from_numpy(spheres).to(poses)
    normal = torch.from_numpy(np.array(batch.clearance_gradient[:, :3])).to(poses)
    if poses.ndim == 2:
        c_W = poses[:, :3] + _rotated(poses[:, 3:], c_T)
    else:
        c_W = poses[:, :3, 3] + (poses[:, :3, :3] @ c_T[:, :, None])[:, :, 0]
    value = torch.from_numpy(np.array(batch.clearance)).to(poses)
    return value + (normal * (c_W - c_W.detach())).sum(1)


def wrench(tool: _core.Tool, surface: _core.Surface, poses: torch.Tensor) -> torch.Tensor:
    """Force and torque (P, 6), m3 and m4, in W about the tool's center of mass; see `penetration`.

    Its backward is the stiffness in closed form. Gradients of the field longer than 1.05 are not
    shortened, unlike in Contact.measure: here the wrench is the derivative of the potential
    everywhere.
    """
    return _Wrench.apply(_checked(poses), tool, surface)  # type: ignore[no-untyped-call,no-any-return]
