"""`hugwbc export`: a policy as an ONNX file."""

import dataclasses
import pathlib
from collections.abc import Sequence

from hugwbc.cli.output import parse, say


@dataclasses.dataclass(frozen=True)
class ExportOptions:
    """Write a policy as an ONNX file with its contract, and compare it with the policy."""

    policy: str | None = None
    """Name of a shipped policy, or path of a policy file or of a run's folder."""
    out: pathlib.Path = pathlib.Path("out/policy.onnx")
    """The file to write."""


def run(words: Sequence[str]) -> int:
    """Parse, export, say how well the file agrees."""
    options = parse(ExportOptions, words, "export", ExportOptions.__doc__)
    from hugwbc.learned.policy.onnx_export import TOLERANCE, export_onnx
    from hugwbc.learned.policy.policy import DEFAULT_POLICY, load_policy

    difference = export_onnx(load_policy(options.policy or DEFAULT_POLICY), options.out)
    say(f"wrote {options.out}; run by onnxruntime it differs from torch by {difference:.1g} (valid: {TOLERANCE:g})")
    return 0
