import textwrap

import msgspec

from armguard.lab.simulation.processes import start_device
from support.waiting import wait_until


class Lamp(msgspec.Struct, tag=True):
    name: str
    brightness: float


def test_a_device_runs_in_a_process_that_ends_as_it_is_told(tmp_path, monkeypatch):
    (tmp_path / "lamps.py").write_text(
        textwrap.dedent(
            """
            import sys
            import msgspec
            from armguard.lab.simulation.processes import run_device

            class Lamp(msgspec.Struct, tag=True):
                name: str
                brightness: float

                def run(self):
                    sys.stderr.write(f"{self.name}: ")
                    for line in sys.stdin:
                        sys.stderr.write(line)
                        sys.stderr.flush()

            run_device(Lamp)
            """
        )
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Lamp, "__module__", "lamps")
    with (tmp_path / "log").open("wb") as log:
        process = start_device(Lamp("red", 1.0), log, takes_orders=True)
        assert process.stdin is not None
        process.communicate(b"on\n")
        assert process.returncode == 0
        silent = start_device(Lamp("green", 1.0), log)
        assert silent.wait() == 0, "it has no standard input to read"
        ended = start_device(Lamp("blue", 1.0), log, takes_orders=True)
        ended.stdin.write(b"on\n")
        ended.stdin.flush()
        wait_until(lambda: b"blue" in (tmp_path / "log").read_bytes())
        ended.terminate()
        assert ended.wait() == 0
        ended.stdin.close()
    assert (tmp_path / "log").read_text().startswith("red: on\n")
