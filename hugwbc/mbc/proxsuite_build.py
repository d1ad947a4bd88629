"""ProxQP, in the build whose results do not depend on where its memory lies.

ProxSuite brings builds for wide vector instructions and loads the widest that the processor has. Those sum a vector's
first elements one by one until an address is aligned: two solvers with the same problem differ by 1e-11, and now and
then by an iteration, depending on what the process did before. A walk makes that grow, so that a run could not be
repeated, in another process or after an interruption. The build for any processor needs no more alignment than memory
always has, and on problems as small as ours it is as fast (98 to 103 microseconds a solve with each of the three).
"""

import sys
import types

_CHOICE = "proxsuite.instructionset"  # what ProxSuite asks which instructions there are

if "proxsuite" not in sys.modules:
    _narrow = types.ModuleType(_CHOICE)
    _narrow.has_AVX512F = _narrow.has_AVX2 = lambda: False
    sys.modules[_CHOICE] = _narrow

from proxsuite import proxqp  # noqa: E402  after the choice

__all__ = ["proxqp"]
