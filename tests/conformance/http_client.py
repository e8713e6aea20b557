"""Plain HTTP as `curl` speaks it, one connection for each request, for the conformance cases."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from typing import Any, Dict, Tuple

from step_failed import StepFailed

_TIMEOUT_S = 120.0


class HttpClient:
    """Sends what stands in ``http`` of a step."""

    has_status = True

    def __init__(self, address: str, bearer: str) -> None:
        self._base, self._bearer = f"http://{address}/api/v1", bearer

    def request(self, request: Any) -> Any:
        """Sends a request of the wire."""
        return self._json("POST", "/requests", request)

    def call(self, step: Dict[str, Any]) -> Any:
        """Returns the answer to a step."""
        method, path, *body = step["http"]
        answer = self._json(method, path, *body)
        if path != "/requests":
            return answer
        # Requests of the wire are answered with the name of the answer's type.
        response = answer["response"]
        return {"done": True} if response == "Done" else next(iter(response.values()))

    def picture(self, step: Dict[str, Any]) -> Tuple[int, int, bytes]:
        """Returns the picture of a step."""
        method, path = step["http"]
        headers, body = self._send(method, path)
        width, height = headers["polyptych-width"], headers["polyptych-height"]
        return int(width), int(height), body

    def _json(self, method: str, path: str, *body: Any) -> Any:
        return json.loads(self._send(method, path, *body)[1])

    def _send(self, method: str, path: str, *body: Any) -> Tuple[Any, bytes]:
        headers = {"Authorization": f"Bearer {self._bearer}"}
        data = None
        if body:
            headers["Content-Type"] = "application/json"
            data = json.dumps(body[0]).encode()
        request = urllib.request.Request(self._base + path, data, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as answer:
                return answer.headers, answer.read()
        except urllib.error.HTTPError as error:
            reason = json.loads(error.read())["error"]
            raise StepFailed("HTTP", reason, error.code) from None
