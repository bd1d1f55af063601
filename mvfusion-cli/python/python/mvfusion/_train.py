"""Training."""

from __future__ import annotations

import operator
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from . import _mvfusion
from ._run import Run, load


def train(
    config: Mapping[str, Any] | str | os.PathLike[str] | None = None,
    *,
    data: str | os.PathLike[str] | None = None,
    out: str | os.PathLike[str] | None = None,
    callback: Callable[[dict[str, Any]], object] | None = None,
    preset: str | None = None,
    device: str = "auto",
    seed: int | None = None,
    threads: int | None = None,
    lpips_weights: str | os.PathLike[str] | None = None,
    resume: str | os.PathLike[str] | None = None,
    init_from: str | os.PathLike[str] | None = None,
    force: bool = False,
    verbose: bool = False,
) -> Run:
    """Train on a scene, evaluate, and write a run folder, as ``mvfusion train`` does.

    Other Python threads run meanwhile. Ctrl-C saves a checkpoint after the current step and raises
    `KeyboardInterrupt`; once the training is done, it ends the evaluation after a view, and `resume` does the rest.

    Parameters
    ----------
    config : dict, path or str, optional
        A dict of keys, nested or dotted (``{"train.scale": 0.1}``), a TOML file, or the name of a preset. ``mvfusion
        config`` prints all keys.
    data : path, optional
        The scene folder. By default, a built-in scene.
    out : path, optional
        The run folder. By default, ``runs/NAME-SEED``.
    callback : callable, optional
        Is called with a dict for every ``train.log_interval`` steps, in the calling thread, while the training waits:
        ``step``, ``stage``, ``stage_step``, ``loss``, ``psnr`` (``None`` if it is infinite), ``gaussians`` (a dict of
        the branches), ``steps_per_second``, ``elapsed`` and what else a line of ``metrics.jsonl`` has. If it returns
        ``False``, or raises an exception, the training ends with a checkpoint; the exception is raised again.
    preset : str, optional
        The preset to start from, below `config`. By default, it is chosen by the format of the scene.
    device : str
        ``"auto"`` (a GPU if there is one), ``"cpu"``, or a name of ``mvfusion devices``.
    seed : int, optional
        Seed of all random numbers of the run.
    threads : int, optional
        CPU threads; the result does not depend on their number. By default, one for each core.
    lpips_weights : path, optional
        Folder with the LPIPS weights.
    resume : path, optional
        Continue the run in this folder from its newest checkpoint. `config` may then change only keys that do not
        change what it learns.
    init_from : path, optional
        Begin with the weights of another run.
    force : bool
        Replace the run in `out`.
    verbose : bool
        Print notes and progress to stderr.

    Returns
    -------
    Run
        The run, opened on `device`. If the callback ended it, ``Run.is_finished`` is false and ``train(resume=...)``
        continues it.

    Raises
    ------
    UsageError
        For an unknown key, preset or device, or a value that training does not accept, before anything is written.
    MvfusionError
        If the scene cannot be read, the memory does not suffice, or the training fails.

    Examples
    --------
    >>> def stop(line):
    ...     print(line["step"], line["psnr"])
    ...     return line["step"] < 100
    >>> run = mvfusion.train({"train.scale": 0.1}, out="runs/short", callback=stop)
    """
    table, config_file, preset = _sources(config, preset)
    if callback is not None and not callable(callback):
        raise _mvfusion.UsageError(f"the callback is of type {type(callback).__name__}, which cannot be called.")
    for name, number, least in ("seed", seed, 0), ("threads", threads, 1):
        if number is not None and operator.index(number) < least:
            raise _mvfusion.UsageError(f"{name} is {number}, and the least is {least}.")
    if resume is not None:
        others = {"out": out, "preset": preset, "a file": config_file, "seed": seed, "init_from": init_from}
        given = [name for name, value in others.items() if value is not None] + ["force"] * force
        if given:
            raise _mvfusion.UsageError(f"a run that is resumed keeps its own folder and settings: leave out {given[0]}.")
    order = {
        "config": table,
        "config_file": config_file,
        "preset": preset,
        "data": data,
        "out": out,
        "device": device,
        "seed": seed,
        "threads": threads,
        "lpips_weights": lpips_weights,
        "resume": resume,
        "init_from": init_from,
        "force": force,
        "verbose": verbose,
    }
    return load(_mvfusion.train(order, callback), device=device, data=data)


def _sources(
    config: Mapping[str, Any] | str | os.PathLike[str] | None, preset: str | None
) -> tuple[dict[str, Any] | None, Path | None, str | None]:
    """The table, the file and the preset of a configuration."""
    if config is None:
        return None, None, preset
    if isinstance(config, Mapping):
        return _nested(config), None, preset
    # A bare word is a preset, unless there is such a file.
    is_word = isinstance(config, str) and not Path(config).suffix and os.sep not in config
    if preset is None and is_word and not Path(config).exists():
        return None, None, str(config)
    return None, Path(config), preset


def _nested(config: Mapping[str, Any]) -> dict[str, Any]:
    """The same keys as nested dicts. A later key overrides an earlier one."""
    nested: dict[str, Any] = {}
    for key, value in config.items():
        if not isinstance(key, str):
            raise _mvfusion.UsageError(f"the configuration has the key {key!r}, and keys are strings.")
        *tables, name = key.split(".")
        place = nested
        for table in tables:
            inner = place.get(table)
            if not isinstance(inner, dict):
                inner = place[table] = {}
            place = inner
        if value is None:
            raise _mvfusion.UsageError(f"`{key}` is None; leave the key out to keep its default.")
        if isinstance(value, Mapping):
            _overlay(place, name, _nested(value))
        else:
            place[name] = _plain(value)
    return nested


def _overlay(place: dict[str, Any], name: str, table: dict[str, Any]) -> None:
    if not isinstance(place.get(name), dict):
        place[name] = table
        return
    for key, value in table.items():
        if isinstance(value, dict):
            _overlay(place[name], key, value)
        else:
            place[name][key] = value


def _plain(value: object) -> object:
    """Python's own value for a path, and for NumPy's numbers and arrays."""
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value
