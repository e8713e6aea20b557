"""Runs the conformance cases against a wall, with the Python package or with plain HTTP.

    run.py python ADDRESS TOKEN_FILE    with PYTHONPATH at client-api/python
    run.py http ADDRESS BEARER          with what `polyptych login --token` prints

Prints a line for each case, and ends with 1 if one of them failed.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Dict, List

import patterns
from step_failed import StepFailed

FILES = ("pictures", "edits", "questions", "presentation", "sessions", "refusals")


def main(arguments: List[str]) -> int:
    """Runs all cases; returns the exit code."""
    kind, address, secret = arguments
    if kind == "python":
        from python_client import PythonClient

        client: Any = PythonClient(address, secret)
    else:
        from http_client import HttpClient

        client = HttpClient(address, secret)
    folder = Path(__file__).parent
    reset = json.loads((folder / "reset.json").read_text("utf-8"))["requests"]
    passed = failed = 0
    for name in FILES:
        for case in json.loads((folder / f"{name}.json").read_text("utf-8"))["cases"]:
            faults = run_case(client, reset, case)
            print(f"{'FAILED' if faults else 'ok'}  {kind} {name}: {case['name']}", flush=True)
            for fault in faults:
                print(f"        {fault}", flush=True)
            passed, failed = passed + (not faults), failed + bool(faults)
    print(f"{kind}: {passed} cases passed, {failed} failed")
    return 1 if failed or not passed else 0


def run_case(client: Any, reset: List[Any], case: Dict[str, Any]) -> List[str]:
    """Returns what is wrong with a case; the first step that is wrong ends it."""
    for request in reset:
        client.request(request)
    for number, step in enumerate(case["steps"], 1):
        faults = run_step(client, step)
        if faults:
            return [f"step {number}, {step['call']}: {fault}" for fault in faults]
    return []


def run_step(client: Any, step: Dict[str, Any]) -> List[str]:
    """Returns what is wrong with a step."""
    try:
        if "picture" in step:
            width, height, rgba = client.picture(step)
            return patterns.picture_differences(step["picture"], width, height, rgba)
        answer = client.call(step)
    except StepFailed as error:
        if "error" not in step:
            return [str(error)]
        return error_differences(step["error"], error, client.has_status)
    if "error" in step:
        return [f"it was not refused, but answered {answer!r}"]
    pattern = step["answer"]
    if client.has_status and "http_answer" in step:
        pattern = step["http_answer"]
    return patterns.differences(pattern, answer)


def error_differences(wanted: Dict[str, Any], error: StepFailed, has_status: bool) -> List[str]:
    """Returns what is wrong with an error."""
    found = patterns.differences(wanted["reason"], error.reason, "reason")
    if has_status and error.status != wanted["status"]:
        found.append(f"status {error.status}, not {wanted['status']}: {error.reason}")
    if not has_status and error.kind != wanted["class"]:
        found.append(f"{error.kind}, not {wanted['class']}: {error.reason}")
    return found


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
