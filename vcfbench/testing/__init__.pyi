# Public names of vcfbench.testing, and where each is: the one list of them.

from vcfbench.testing.benches import ServedLab as ServedLab
from vcfbench.testing.benches import SimulatedLab as SimulatedLab
from vcfbench.testing.benches import open_simulated as open_simulated
from vcfbench.testing.benches import serve_simulated as serve_simulated
from vcfbench.testing.benches import simulated as simulated
from vcfbench.testing.conformance import ConformanceCase as ConformanceCase
from vcfbench.testing.conformance import conformance_problems as conformance_problems
from vcfbench.testing.conformance import model_case as model_case
from vcfbench.testing.conformance import scpi_case as scpi_case
from vcfbench.testing.disk import Disk as Disk
from vcfbench.testing.disk import DiskState as DiskState
from vcfbench.testing.exchange import Exchange as Exchange
from vcfbench.testing.exchange import ScriptedWire as ScriptedWire
from vcfbench.testing.exchange import expected_exchange as expected_exchange
from vcfbench.testing.exchange import over_serial as over_serial
from vcfbench.testing.exchange import over_visa as over_visa
from vcfbench.testing.replay import ReplayWire as ReplayWire
from vcfbench.testing.replay import read_trace as read_trace
from vcfbench.testing.replay import replay_trace as replay_trace
from vcfbench.testing.soaking import Verdict as Verdict
from vcfbench.testing.soaking import shrunk as shrunk
from vcfbench.testing.soaking import soak as soak
from vcfbench.testing.soaking import tried as tried
from vcfbench.testing.soaking.draw import Draw as Draw
from vcfbench.testing.soaking.draw import drawn as drawn
