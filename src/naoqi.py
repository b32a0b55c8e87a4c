"""ALProxy, ALBroker and ALModule for NAOqi scripts on Python 3, over the `qi` package.

NAOqi's own module, if it is installed, is taken instead.
"""

import sys
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path

_others = [p for p in sys.path if Path(p or ".").resolve() != Path(__file__).resolve().parent]
_own = PathFinder.find_spec("naoqi", _others)

if _own is not None and _own.loader is not None:
    sys.modules[__name__] = module_from_spec(_own)
    _own.loader.exec_module(sys.modules[__name__])
else:
    from doorway3ds.robots.nao.proxies import ALBroker, ALModule, ALProxy

    __all__ = ["ALBroker", "ALModule", "ALProxy"]
