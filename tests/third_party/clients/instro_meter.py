"""Run in instro's environment: serves its simulated multimeter, under the identity that is asked for."""

from __future__ import annotations

import logging
import sys
import threading

from instro.dmm.scpi_sim_server import SimulatedDMM, SimulatedDMMServer

logging.disable(logging.WARNING)


def main() -> None:
    meter = SimulatedDMM(stimulus={"VOLT:DC": 1.25})
    if len(sys.argv) > 1:
        meter.id = sys.argv[1]
    server = SimulatedDMMServer(meter, port=0)
    server.start()
    sys.stdout.write(f"{server.port}\n")
    sys.stdout.flush()
    threading.Event().wait()


if __name__ == "__main__":
    main()
