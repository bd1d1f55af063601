"""Train, load and render MVFusion-GS from Python.

MVFusion-GS reconstructs dynamic scenes as Gaussians: a static and a dynamic branch, separated without supervision.
This package wraps the program ``mvfusion``. A run that one of them has trained opens in the other.

Examples
--------
>>> import mvfusion
>>> run = mvfusion.load("runs/quickstart-0")
>>> view = run.views[0]
>>> image = run.render(view.camera, view.time)["composed"]
>>> image.shape, image.dtype
((120, 160, 3), dtype('float32'))
"""

from ._camera import Camera
from ._mvfusion import MvfusionError, UsageError, __version__
from ._run import Run, View, load
from ._train import train

__all__ = ["Camera", "MvfusionError", "Run", "UsageError", "View", "__version__", "load", "train"]
