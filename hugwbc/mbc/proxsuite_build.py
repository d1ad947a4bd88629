"""The build of ProxQP whose results do not depend on memory alignment.

ProxSuite comes in builds for wide vector instructions and loads the widest one that the processor supports. These
builds sum the first elements of a vector one by one until an address is aligned. Two solvers with the same problem
therefore differ by 1e-11, and sometimes by an iteration, depending on what the process did before. A walk amplifies
that, so that a run could not be repeated in another process or after an interruption. The build for any processor needs
no more alignment than memory always has. On problems as small as these it is as fast: 98 to 103 microseconds per solve
with each of the three builds.
"""

import sys
import types

_CHOICE = "proxsuite.instructionset"  # the module that ProxSuite asks for the instructions of the processor

if "proxsuite" not in sys.modules:
    _narrow = types.ModuleType(_CHOICE)
    _narrow.has_AVX512F = _narrow.has_AVX2 = lambda: False
    sys.modules[_CHOICE] = _narrow

from proxsuite import proxqp  # noqa: E402  only after the choice is made

__all__ = ["proxqp"]
