"""A pinhole camera."""

from __future__ import annotations

import operator

import numpy as np
import numpy.typing as npt

from . import _mvfusion
from ._mvfusion import UsageError


class Camera:
    """A pinhole camera with its pose, in OpenCV axes: x right, y down, z forward.

    A world point ``x`` has the camera coordinates ``R @ x + t``, where ``[R | t]`` is `world_to_camera`. A camera point
    ``(x, y, z)`` projects to the pixel position ``(fx * x / z + cx, fy * y / z + cy)``. The centre of the first pixel is
    at ``(0.5, 0.5)``. Cameras do not change.

    Parameters
    ----------
    intrinsics : array_like, shape (3, 3) or (4,)
        The matrix ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``, or ``fx, fy, cx, cy``, in pixels.
    world_to_camera : array_like, shape (4, 4) or (3, 4)
        The rotation and the translation from world to camera, in world units. Its inverse is the camera's pose.
    size : (int, int)
        Width and height of the image in pixels.

    Raises
    ------
    UsageError
        If a shape is wrong, a matrix is not of that form, or the camera cannot be rendered.

    Examples
    --------
    >>> camera = Camera([100, 100, 80, 60], np.eye(4), size=(160, 120))
    >>> camera.centre
    array([0., 0., 0.])
    """

    # Largest deviation of a rotation from orthonormality: single precision errs by 1e-7, files with few digits by 1e-4.
    _TOLERANCE = 1e-3

    def __init__(
        self, intrinsics: npt.ArrayLike, world_to_camera: npt.ArrayLike, size: tuple[int, int]
    ) -> None:
        self._lens = _lens(intrinsics)
        pose = _numbers("world_to_camera", world_to_camera)
        if pose.shape not in ((4, 4), (3, 4)):
            raise UsageError(f"world_to_camera has the shape {pose.shape}, not (4, 4) or (3, 4).")
        if pose.shape == (4, 4) and not np.allclose(pose[3], [0, 0, 0, 1], rtol=0, atol=1e-9):
            raise UsageError(f"the last row of world_to_camera is {pose[3].tolist()}, not [0, 0, 0, 1].")
        rotation, self._translation = pose[:3, :3], pose[:3, 3]
        off = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if not (off <= self._TOLERANCE and np.linalg.det(rotation) > 0):
            raise UsageError(
                "the left 3x3 block of world_to_camera is no rotation: its rows must have length 1, stand at right "
                "angles and form a right-handed system."
            )
        self._rotation = rotation
        try:
            width, height = (operator.index(side) for side in size)
        except (TypeError, ValueError):
            raise UsageError(f"the size is {size!r}, not (width, height) in whole pixels.") from None
        if width < 1 or height < 1:
            raise UsageError(f"the size is {size!r}, and an image has at least one pixel along each side.")
        self._size = (width, height)
        _mvfusion.check_camera(self._numbers)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image in pixels."""
        return self._size

    @property
    def intrinsics(self) -> npt.NDArray[np.float64]:
        """The matrix ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``, in pixels."""
        fx, fy, cx, cy = self._lens
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])

    @property
    def world_to_camera(self) -> npt.NDArray[np.float64]:
        """The rotation and the translation from world to camera, shape (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self._rotation, self._translation
        return matrix

    @property
    def centre(self) -> npt.NDArray[np.float64]:
        """The camera's place in the world, shape (3,)."""
        # Without -0.0, which would be printed.
        return 0.0 - self._rotation.T @ self._translation

    def resized(self, width: int, height: int) -> Camera:
        """The same camera for its image resized to `width` by `height` pixels."""
        x, y = width / self._size[0], height / self._size[1]
        return Camera(self._lens * [x, y, x, y], self.world_to_camera, (width, height))

    @property
    def _numbers(self) -> tuple[tuple[int, int], list[float], list[float], list[float]]:
        return self._size, self._lens.tolist(), self._rotation.ravel().tolist(), self._translation.tolist()

    def __eq__(self, other: object) -> bool:
        return self._numbers == other._numbers if isinstance(other, Camera) else NotImplemented

    def __hash__(self) -> int:
        size, *numbers = self._numbers
        return hash((size, *map(tuple, numbers)))

    def __repr__(self) -> str:
        width, height = self._size
        return f"<mvfusion.Camera {width}x{height}, fx {self._lens[0]:.6g}, centre {np.round(self.centre, 4).tolist()}>"


def _lens(intrinsics: npt.ArrayLike) -> npt.NDArray[np.float64]:
    matrix = _numbers("intrinsics", intrinsics)
    if matrix.shape == (4,):
        return matrix
    if matrix.shape != (3, 3):
        raise UsageError(f"intrinsics has the shape {matrix.shape}, not (3, 3) or (4,).")
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    if not np.array_equal(matrix, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]):
        raise UsageError(
            f"intrinsics is {matrix.tolist()}, not of the form [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]: a skew or a "
            "lens cannot be rendered."
        )
    return np.array([fx, fy, cx, cy])


def _numbers(name: str, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise UsageError(f"{name} is no array of numbers: {error}.") from None
