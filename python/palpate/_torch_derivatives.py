"""Derivatives of palpate.torch by the numbers of poses, for PyTorch's automatic differentiation.

    first derivatives:   J^T g, times by_value        _Gradient, by the Slope g of a Value
    second derivatives:  of that by by_value          _Gradient's backward
                         of that by the poses         _Bend's backward

Each is one call of _core.pull_back, and only those run that PyTorch wants.
"""

from __future__ import annotations

from typing import Any, Callable, Dict, NamedTuple, Optional, Tuple

import torch

from palpate import _core


class Slope(NamedTuple):
    """A derivative by motions: factor times that by a shift of p_TC, and by a turn about it; (P, 3) each."""

    factor: float
    by_shift: torch.Tensor
    by_turn: torch.Tensor
    p_TC: torch.Tensor
    #: What _core.pull_back needs for second derivatives, at poses; None: they are not known.
    second: Optional[Callable[[torch.Tensor], Dict[str, torch.Tensor]]] = None


def stream_of(device: torch.device) -> Any:
    return torch.cuda.current_stream(device) if device.type == "cuda" else None


def _rows(values: torch.Tensor) -> torch.Tensor:
    """The same with the numbers of each row side by side."""
    return values if values.stride(-1) == 1 else values.contiguous()


def _pull_back(
    poses: torch.Tensor,
    p_TC: torch.Tensor,
    by_shift: torch.Tensor,
    by_turn: torch.Tensor,
    factor: float,
    scale: Optional[torch.Tensor],
    along: Optional[torch.Tensor],
    stiffness: Optional[torch.Tensor],
    p_CQ: Optional[torch.Tensor],
) -> torch.Tensor:
    """Derivatives as _core.pull_back, in the shape and type of the poses; of `along` alone its products (P,)."""
    poses = poses.contiguous()
    is_product = along is not None and stiffness is None and p_CQ is None
    out = poses.new_empty(len(poses)) if is_product else torch.empty_like(poses)
    _core.pull_back(
        poses,
        p_TC,
        _rows(by_shift),
        _rows(by_turn),
        None if is_product else out,
        factor=factor,
        scale=scale,
        along=None if along is None else along.contiguous(),
        stiffness=stiffness,
        p_CQ=p_CQ,
        by_scale=out if is_product else None,
        stream=stream_of(poses.device),
    )
    return out


# An operator of PyTorch, which calls it once for each of a batch of derivatives (is_grads_batched, vectorize).
_operators = torch.library.Library("palpate", "DEF")  # type: ignore[no-untyped-call]
_operators.define(  # type: ignore[no-untyped-call]
    "pull_back(Tensor poses, Tensor p_TC, Tensor by_shift, Tensor by_turn, float factor, "
    "Tensor? scale, Tensor? along, Tensor? stiffness, Tensor? p_CQ) -> Tensor"
)
for _device in ("CPU", "CUDA"):
    _operators.impl("pull_back", _pull_back, _device)  # type: ignore[no-untyped-call]


def pulled_back(
    slope: Slope,
    poses: torch.Tensor,
    scale: Optional[torch.Tensor] = None,
    along: Optional[torch.Tensor] = None,
    stiffness: Optional[torch.Tensor] = None,
    p_CQ: Optional[torch.Tensor] = None,
) -> torch.Tensor:
    derivative: torch.Tensor = torch.ops.palpate.pull_back.default(
        poses, slope.p_TC, slope.by_shift, slope.by_turn, slope.factor, scale, along, stiffness, p_CQ
    )
    return derivative


class Value(torch.autograd.Function):
    """A value (P,) with this slope, in the type of the poses."""

    @staticmethod
    def forward(ctx: Any, poses: torch.Tensor, value: torch.Tensor, slope: Slope) -> torch.Tensor:
        ctx.slope = slope
        ctx.save_for_backward(poses)
        return value.to(poses.dtype).detach()  # another tensor over the same numbers

    @staticmethod
    def backward(ctx: Any, by_value: torch.Tensor) -> Tuple[Any, ...]:
        (poses,) = ctx.saved_tensors
        if not torch.is_grad_enabled() or not torch._C._functorch.is_legacy_batchedtensor(by_value):
            return _gradient(poses, by_value, ctx.slope), None, None
        # PyTorch keeps no graph of a batch through functions: one gradient is a function, the products with it are not.
        gradient = _gradient(poses, poses.new_ones(len(poses)), ctx.slope)
        return by_value[(..., *[None] * (poses.dim() - 1))] * gradient, None, None


def _gradient(poses: torch.Tensor, by_value: torch.Tensor, slope: Slope) -> torch.Tensor:
    bent = _Bend.apply(poses, (by_value,), slope)  # type: ignore[no-untyped-call]
    gradient: torch.Tensor = _Gradient.apply(bent, by_value, slope)  # type: ignore[no-untyped-call]
    return gradient


class _Bend(torch.autograd.Function):
    """The poses of a gradient, whose backward turns a direction into the gradient's derivative along it.

    Apart from _Gradient, so that PyTorch asks for it, and for the stiffness, only where derivatives by the poses are
    wanted; by_value is in a tuple, since its own derivative is _Gradient's.
    """

    @staticmethod
    def forward(ctx: Any, poses: torch.Tensor, by_value: Tuple[torch.Tensor], slope: Slope) -> torch.Tensor:
        ctx.slope = slope
        ctx.save_for_backward(poses, *by_value)
        return poses.detach()

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, direction: torch.Tensor) -> Tuple[Any, ...]:
        poses, by_value = ctx.saved_tensors
        if ctx.slope.second is None:
            raise RuntimeError("the volume has no second derivative; take that of the potential")
        return pulled_back(ctx.slope, poses, by_value, direction, **ctx.slope.second(poses)), None, None


class _Gradient(torch.autograd.Function):
    """The gradient of a value by the poses, times by_value."""

    @staticmethod
    def forward(ctx: Any, poses: torch.Tensor, by_value: torch.Tensor, slope: Slope) -> torch.Tensor:
        ctx.slope = slope
        ctx.save_for_backward(poses)
        return pulled_back(slope, poses, by_value)

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, direction: torch.Tensor) -> Tuple[Any, ...]:
        (poses,) = ctx.saved_tensors
        by_value = pulled_back(ctx.slope, poses, along=direction) if ctx.needs_input_grad[1] else None
        return direction, by_value, None  # see _Bend
