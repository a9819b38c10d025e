"""Resets, and requests that contact be wanted: both need the token of the run."""

from __future__ import annotations

import hmac

from armguard.messages.incoming import (
    IgnoreMessage,
    MessageError,
    ResetMessage,
    WatchMessage,
    to_rows,
)
from armguard.streams.arm_names import ArmNames
from armguard.streams.intake import Intake
from armguard.streams.requests import ExemptionRequest, Requests
from armguard.streams.stamp_clocks import StampClock
from armguard.verdict import ResetVerdict


class TokenIntake:
    """Takes resets and what is asked about contact that is wanted.

    Args:
        intake: Where faults are counted, and times.
        requests: Where it is noted what was asked.
        arms: The arms of the cell.
        clock: How joint states are stamped.
        token: What a message must carry that asks for a reset, or for contact to be wanted; without
            one, none is obeyed.
    """

    def __init__(
        self,
        intake: Intake,
        requests: Requests,
        arms: ArmNames,
        clock: StampClock,
        token: str | None,
    ) -> None:
        self._intake = intake
        self._requests = requests
        self._arms = arms
        self._clock_error = clock.error
        # The end of an exemption is a time to come, which no latency has made old.
        self._clock = clock._replace(latency=0.0)
        self._token = token

    def take_exemption(self, message: IgnoreMessage) -> None:
        """Hand on what is asked; what cannot be read, or has no token, is counted."""
        faults, number = self._intake.faults, message.number
        if not self._is_token(message.token):
            problem = "token is not the one of this run"
            faults.add("ignore refused", "exemptions", number, problem)
            return
        zone, until = None, message.until
        try:
            if message.arm != self._arms.watched:
                raise self._arms.refuse(message)
            if message.zone is not None:
                size = len(message.zone)
                size = size // 24 if isinstance(message.zone, bytes) else size
                zone = to_rows("zone", message.zone, size, 3)
        except MessageError as error:
            faults.add("malformed", "exemptions", number, str(error))
            return
        if until is not None:
            until = self._intake.times.translate(until, self._clock)[0] - self._clock_error
        self._requests.exemptions.append(
            ExemptionRequest(
                number,
                is_end=False,
                link=message.link,
                ids=message.ids,
                source=message.source,
                until=until,
                zone=zone,
            )
        )

    def take_end(self, message: WatchMessage) -> None:
        """Hand on that an exemption is to end."""
        try:
            if message.arm != self._arms.watched:
                raise self._arms.refuse(message)
        except MessageError as error:
            self._intake.faults.add("malformed", "exemptions", message.number, str(error))
            return
        self._requests.exemptions.append(ExemptionRequest(message.number, is_end=True))

    def take_reset(self, message: ResetMessage) -> None:
        """Hand on a reset that names the watched arm, and has the token of this run."""
        requests, problem = self._requests, "token is not the one of this run"
        if self._token is None:
            problem = "this run was started without --reset-token, and obeys none"
        try:
            if message.arm != self._arms.watched:
                raise self._arms.refuse(message)
            is_obeyed = self._is_token(message.token)
        except MessageError as error:
            is_obeyed, problem = False, str(error)
        if message.number is not None:
            verdict = ResetVerdict(is_obeyed, "" if is_obeyed else problem)
            requests.reset_verdicts.append((message.number, verdict))
        if not is_obeyed:
            self._intake.faults.add("reset refused", "unknown", None, problem)
            return
        requests.is_reset = True
        # A reset ends what was asked for a time, and is obeyed before all requests.
        requests.exemptions = [one for one in requests.exemptions if one.until is None]

    def _is_token(self, token: str) -> bool:
        known = self._token
        return known is not None and hmac.compare_digest(token.encode(), known.encode())
