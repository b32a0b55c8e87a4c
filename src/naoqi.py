"""ALProxy, ALBroker and ALModule for NAOqi scripts on Python 3, over the `qi` package.

NAOqi's own module, if it is installed, is taken instead.
"""

import sys
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from itertools import dropwhile
from pathlib import Path

_here = Path(__file__).resolve().parent
# What comes before is found before. Only what comes after: two copies of this must not take turns.
_after = list(dropwhile(lambda folder: Path(folder or ".").resolve() != _here, sys.path))[1:]
_own = PathFinder.find_spec("naoqi", _after)

if _own is not None and _own.loader is not None:
    sys.modules[__name__] = module_from_spec(_own)
    _own.loader.exec_module(sys.modules[__name__])
else:
    from doorway3ds.robots.nao.proxies import ALBroker, ALModule, ALProxy

    __all__ = ["ALBroker", "ALModule", "ALProxy"]
