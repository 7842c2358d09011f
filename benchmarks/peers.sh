#!/bin/sh
# One virtual environment a peer, from PyPI, under $PEERS (default $HOME/.cache/vcfbench-peers), outside the repository.
# benchmarks/tcp.py finds them there. Takes some minutes and about 500 MB.
set -eu
PEERS=${PEERS:-$HOME/.cache/vcfbench-peers}
PYTHON=${PYTHON:-python3}
make_env() {
    name=$1
    shift
    [ -x "$PEERS/$name/bin/python" ] || "$PYTHON" -m venv "$PEERS/$name"
    "$PEERS/$name/bin/python" -m pip install --quiet "$@" || echo "peers: $name could not be installed, it is left out" >&2
}
make_env instro 'instro==1.22.0' pyvisa-py pyvisa-sim
make_env sinstruments 'sinstruments==1.5.0'
make_env lewis 'lewis==1.3.3'
make_env tickit 'tickit==0.4.3'
