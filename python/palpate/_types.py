"""Types of arguments, for type checkers."""

from __future__ import annotations

from typing import Any, Callable, Protocol, Tuple, Union

import numpy.typing


class SupportsDLPack(Protocol):
    """An array of PyTorch, CuPy, JAX and others."""

    def __dlpack__(self, *args: Any, **kwargs: Any) -> Any: ...

    def __dlpack_device__(self) -> Tuple[Any, Any]: ...


#: Anything with DLPack or the buffer protocol, or a list of numbers.
Array = Union[numpy.typing.ArrayLike, SupportsDLPack]

#: Called with the number of spheres, the fill and the last radius in m; False ends the packing.
Progress = Callable[[int, float, float], Union[bool, None]]


#: A CUDA stream: cudaStream_t as a number, or torch.cuda.Stream, cupy.cuda.Stream.
Stream = Any


class Device(Protocol):
    """A haptic device in Python: see palpate.touch."""

    def read(self) -> Any:
        """The handle's pose X_BH, (4, 4) or (7,), or (pose, buttons); None: no state."""

    def write(self, wrench: Any) -> Any:
        """Renders a wrench: (6,) force and torque at the handle in B, N and N m."""
