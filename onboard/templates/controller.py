"""An operator's controller on the line of the onboard runtime: a template.

    python onboard/templates/controller.py 5003

``Buttons`` reads what is typed where contacts would be read (``steering 0.3``: pressed for 0.3 s): put your inputs
into it. The override button has two contacts, one of which is always closed, so that a cut wire is noticed; an
emergency stop is wired past all computers, and only reported here.
"""

import sys
import threading
import time

from line import Line

OVERRIDE_FIRST, OVERRIDE_SECOND = 1, 2
BITS = {"estop": 4, "steering": 8, "plus": 16, "minus": 32, "brake": 64, "corner": 128}
PERIOD_NS = 20_000_000


class Buttons:
    """Contacts: lines of standard input, a name and for how long it is pressed."""

    def __init__(self) -> None:
        self._until_s: dict[str, float] = {}
        threading.Thread(target=self._read, daemon=True).start()

    def bits(self) -> int:
        """As in controller_status."""
        now_s = time.monotonic()
        pressed = {name for name, until_s in list(self._until_s.items()) if now_s < until_s}
        override = OVERRIDE_FIRST if "override" in pressed else OVERRIDE_SECOND
        return override | sum(bit for name, bit in BITS.items() if name in pressed)

    def _read(self) -> None:
        for text in sys.stdin:
            name, _, seconds = text.strip().partition(" ")
            if name in BITS or name == "override":
                self._until_s[name] = time.monotonic() + float(seconds or 0.3)
            else:
                print(f"{name}: expected override, {', '.join(BITS)}", file=sys.stderr, flush=True)


def main() -> None:
    """Serve until Ctrl-C; the light is printed where it changes."""
    line, buttons, lit = Line("controller", int(sys.argv[1])), Buttons(), -1
    due_ns = time.monotonic_ns()
    while True:
        for frame, _ in line.take():
            if frame.name == "controller_light" and int(frame.number("light")) != lit:
                lit = int(frame.number("light"))
                print("light on: error" if lit else "light off", flush=True)
        now_ns = time.monotonic_ns()
        if now_ns >= due_ns:
            due_ns = max(due_ns + PERIOD_NS, now_ns)
            line.send("controller_status", buttons=buttons.bits())
        time.sleep(0.001)


if __name__ == "__main__":
    main()
