"""Measurements that stand beside others' programs: a hard set of registration problems, and peers that solve it."""

from benchmarks.process import PeerResult, run_peer
from benchmarks.records import Interval, Record, markdown_table, records_as_json, text_table, wilson
from benchmarks.registration import HardSet, HardSetConfig, load_hard_set, make_hard_set, save_hard_set, success

__all__ = [
    "HardSet",
    "HardSetConfig",
    "Interval",
    "PeerResult",
    "Record",
    "load_hard_set",
    "make_hard_set",
    "markdown_table",
    "records_as_json",
    "run_peer",
    "save_hard_set",
    "success",
    "text_table",
    "wilson",
]
