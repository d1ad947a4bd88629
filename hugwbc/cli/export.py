"""`hugwbc export`: write a policy as an ONNX file."""

import dataclasses
import pathlib
from collections.abc import Sequence

from hugwbc.cli.output import parse, say


@dataclasses.dataclass(frozen=True)
class ExportOptions:
    """Write a policy with its contract as an ONNX file, and compare the file with the policy."""

    policy: str | None = None  # Name of a shipped policy, or path of a policy file or of the folder of a run
    out: pathlib.Path = pathlib.Path("out/policy.onnx")  # File to write


def run(words: Sequence[str]) -> int:
    """Parse the options, export, report how well the file agrees."""
    options = parse(ExportOptions, words, "export")
    from hugwbc.learned.policy import DEFAULT_POLICY, load_policy
    from hugwbc.learned.policy.onnx_export import TOLERANCE, export_onnx

    difference = export_onnx(load_policy(options.policy or DEFAULT_POLICY), options.out)
    say(f"wrote {options.out}; run by onnxruntime it differs from torch by {difference:.1g} (valid: {TOLERANCE:g})")
    return 0
