"""The failure of a step, whichever client met it."""

from __future__ import annotations


class StepFailed(Exception):
    """What a client raised for a step: the name of the error, its reason and HTTP status."""

    def __init__(self, kind: str, reason: str, status: int = 0) -> None:
        super().__init__(f"{kind}: {reason}")
        self.kind, self.reason, self.status = kind, reason, status
