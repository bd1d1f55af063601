"""A trained run."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _mvfusion
from ._camera import Camera


def load(run: str | os.PathLike[str], device: str = "cpu", data: str | os.PathLike[str] | None = None) -> Run:
    """Open a trained run.

    Parameters
    ----------
    run : path
        The run folder. Its newest checkpoint is read: an unfinished run opens, too.
    device : str
        ``"cpu"``, ``"auto"`` (a GPU if there is one), or a name of ``mvfusion devices``.
    data : path, optional
        The scene folder, if it has moved since the training.

    Returns
    -------
    Run

    Raises
    ------
    MvfusionError
        If the folder holds no run, or its scene is not found.
    UsageError
        If there is no such device.
    """
    return Run(_mvfusion.Run(run, device, data), Path(run))


class Run:
    """A trained run: its model, its configuration, its scene and its metrics. `load` and `train` make one.

    Attributes
    ----------
    path : pathlib.Path
        The run folder.
    device : str
        Name of the device on which it is open.
    scene : str
        Name of the scene.
    steps, total_steps : int
        Steps that the model was trained for, and those of the whole run.
    is_finished : bool
        Whether training and evaluation are complete.
    layers : list of str
        The layers that the model can render.
    background : float
        Grey level behind the Gaussians, 0 to 1.
    times : numpy.ndarray, shape (T,)
        The times of the training views, sorted, in [0, 1].
    """

    def __init__(self, native: _mvfusion.Run, path: Path) -> None:
        facts = json.loads(native.facts())
        self._native = native
        self._counts: dict[str, int] = facts["gaussians"]
        self.path = path
        self.device: str = facts["device"]
        self.scene: str = facts["scene"]
        self.steps: int = facts["steps"]
        self.total_steps: int = facts["total_steps"]
        self.is_finished: bool = facts["is_finished"]
        self.layers: list[str] = facts["layers"]
        self.background: float = facts["background"]
        self.times: npt.NDArray[np.float64] = np.array(facts["times"], dtype=np.float64)

    @property
    def metrics(self) -> dict[str, Any] | None:
        """The contents of ``results.json``; ``None`` before the run is evaluated.

        Every evaluation that writes to the run changes the file, so it is read each time.
        """
        text = self._native.metrics()
        return None if text is None else json.loads(text)

    @cached_property
    def config(self) -> dict[str, Any]:
        """The configuration, every key with its value, as nested dicts.

        ``train(run.config)`` repeats the run, unless it began with the weights of another one: run.json then has
        ``init_from``, and `train` needs it too.
        """
        return self._native.config()

    @cached_property
    def views(self) -> list[View]:
        """The training views and, after them, the held-out ones."""
        return [View(self._native, facts) for facts in json.loads(self._native.views())]

    def gaussians(
        self,
        time: float | None = None,
        branch: Literal["dynamic", "static", "scene"] = "dynamic",
        without_mfta: bool = False,
    ) -> dict[str, npt.NDArray[np.float32]]:
        """The Gaussians of a branch, activated.

        Parameters
        ----------
        time : float, optional
            Time in [0, 1] to which the dynamic Gaussians are deformed. Without it, they are the canonical ones, before
            deformation. Static Gaussians are the same at all times.
        branch : {"dynamic", "static", "scene"}
            ``"scene"`` is both branches in one cloud without masks, for programs that know none: it needs a `time`,
            and only approximates a render (docs/interchange.md).
        without_mfta : bool
            Deform without temporal attention, as in the paper's cheaper inference.

        Returns
        -------
        dict of str to numpy.ndarray
            Arrays of ``float32`` with one row for each of N Gaussians, the same as in ``mvfusion export --format npz``:

            ``means`` : (N, 3)
                Centres in world units.
            ``quaternions`` : (N, 4)
                Rotations w, x, y, z of length 1.
            ``scales`` : (N, 3)
                Standard deviations along the axes in world units.
            ``opacities`` : (N,)
                0 to 1.
            ``sh`` : (N, K, 3)
                Spherical harmonics in the order and with the signs of 3DGS; K is 1, 4, 9 or 16; RGB last.
            ``colours`` : (N, 3)
                ``0.5 + 0.2820948 * sh[:, 0]``: the part that does not depend on the direction, not clamped.
            ``masks`` : (N, 3)
                Probabilities of the learned mask: static, brightness, dynamic. Only the dynamic branch has it, beside a
                static one.
            ``time_centres``, ``durations`` : (N,), ``velocities`` : (N, 3)
                Lifetimes, in the time of the views. Only canonical Gaussians have them, if the model does.

        Raises
        ------
        UsageError
            For a time outside [0, 1], or a branch that there is not.
        """
        return _arrays(self._native.gaussians(time, branch, without_mfta))

    def render(
        self,
        camera: Camera,
        time: float | None,
        layers: str | Iterable[str] = ("composed",),
        without_mfta: bool = False,
    ) -> dict[str, npt.NDArray[np.float32]]:
        """Render layers of the model.

        Parameters
        ----------
        camera : Camera
            A camera of `views`, or any other one.
        time : float or None
            Time in [0, 1]. ``None`` shows the static branch alone, as for held-out photos, which have no trained time.
        layers : str or iterable of str
            Names of `layers`, or ``"all"``. ``composed`` is the whole model.
        without_mfta : bool
            Render without temporal attention, as in the paper's cheaper inference.

        Returns
        -------
        dict of str to numpy.ndarray
            Images of ``float32`` by layer: (H, W, 3) for colours (``composed``, ``static``, ``dynamic``,
            ``masked_static``, ``masked_dynamic``), (H, W) for the others. Colours are those of the photos, 0 to 1; where
            nothing covers a pixel, they are the grey level `background`. Only ``static`` may exceed 1. ``depth`` is in
            world units along the camera's axis, 0 where nothing is. The PNG files of ``mvfusion render`` have
            ``np.floor(255 * np.clip(image, 0, 1) + 0.5)`` of colours, masks and alpha.

        Raises
        ------
        UsageError
            For a layer that there is not, or a time outside [0, 1].
        MvfusionError
            If the memory does not suffice.
        """
        if not isinstance(camera, Camera):
            raise _mvfusion.UsageError(f"the camera is of type {type(camera).__name__}, not mvfusion.Camera.")
        names: Sequence[str] = [layers] if isinstance(layers, str) else list(layers)
        if not names:
            raise _mvfusion.UsageError(f"no layer is asked for; the model has {', '.join(self.layers)}.")
        return _arrays(self._native.render(camera._numbers, time, list(names), without_mfta))

    def __repr__(self) -> str:
        counts = " + ".join(f"{count} {branch}" for branch, count in self._counts.items() if count)
        return f"<mvfusion.Run {self.path}: step {self.steps} of {self.total_steps}, {counts} Gaussians, {self.device}>"


class View:
    """An image of a scene: its camera, its time and its photo.

    Attributes
    ----------
    name : str
        Unique within its split, such as ``"cam00/0003"``.
    split : {"train", "test"}
        Whether the model was trained on it or it was held out.
    time : float
        In [0, 1].
    camera : Camera
        For images of the size in which the scene is read.
    """

    def __init__(self, native: _mvfusion.Run, facts: dict[str, Any]) -> None:
        self._native, self._index = native, facts["index"]
        self.name: str = facts["name"]
        self.split: Literal["train", "test"] = facts["split"]
        self.time: float = facts["time"]
        pose = np.column_stack([np.reshape(facts["rotation"], (3, 3)), facts["translation"]])
        self.camera = Camera(facts["intrinsics"], pose, tuple(facts["size"]))

    def photo(self) -> npt.NDArray[np.uint8]:
        """Decode the photo: (H, W, 3) of bytes."""
        _, shape, data = self._native.photo(self.split, self._index)
        return np.frombuffer(data, dtype=np.uint8).reshape(shape)

    def __repr__(self) -> str:
        width, height = self.camera.size
        return f"<mvfusion.View {self.split} {self.name}, {width}x{height}, time {self.time:.4g}>"


def _arrays(packed: list[tuple[str, list[int], bytearray]]) -> dict[str, npt.NDArray[np.float32]]:
    return {name: np.frombuffer(data, dtype=np.float32).reshape(shape) for name, shape, data in packed}
