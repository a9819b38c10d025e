import os
import select
import signal
from concurrent.futures import ThreadPoolExecutor

import pytest

from armguard.app.processes import (
    complain,
    describe_end,
    noted_interrupts,
    termination_as_interrupt,
)

CHILD = """
import os, time
from armguard.app.processes import end_with
end_with(os.getppid())
print(os.getpid(), flush=True)
time.sleep(60)
"""
PARENT = f"""
import subprocess, sys
child = subprocess.Popen([sys.executable, "-c", {CHILD!r}], stdout=subprocess.PIPE)
print(int(child.stdout.readline()), flush=True)
sys.stdin.read()
"""


def test_termination_is_an_interrupt_inside_and_what_it_was_afterwards():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), termination_as_interrupt():
        os.kill(os.getpid(), signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_interrupt_is_noted_and_the_second_one_raised(number):
    with termination_as_interrupt(), noted_interrupts() as was_interrupted:
        assert not was_interrupted()
        signal.raise_signal(number)
        assert was_interrupted()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_thread_that_may_not_handle_signals_notes_none():
    with ThreadPoolExecutor(1) as pool:
        assert not pool.submit(enter_and_ask).result()


def enter_and_ask():
    """What is noted in the thread that calls this."""
    with noted_interrupts() as was_interrupted:
        return was_interrupted()


def has_ended(process, patience):
    """Whether a process ends within `patience` [s]; its descriptor is readable from then on."""
    return bool(select.select([process], [], [], patience)[0])


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0, "with exit code 0"),
        (130, "with exit code 130"),
        (-9, "by SIGKILL"),
        (-15, "by SIGTERM"),
        (-99, "by signal 99"),
    ],
)
def test_an_end_in_words(code, words):
    assert describe_end(code) == words


def test_a_complaint_is_one_line_with_our_name(capsys):
    complain("no such file")
    assert capsys.readouterr() == ("", "armguard: no such file\n")
