"""Robots' processes keep the memory that large messages need."""

import subprocess
import sys

FAULTS = """
import resource, sys
from hw_interface.link.memory import keep_memory

def faults():
    for _ in range(3):  # what is large enough to be given back, and more than one piece of it
        pieces = [bytearray(1_500_000) for _ in range(8)]
        del pieces
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    pieces = [bytearray(1_500_000) for _ in range(8)]
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

loose = faults()
print(loose, keep_memory(), faults())
"""


def test_memory_that_was_freed_is_used_again_without_asking_the_kernel():
    done = subprocess.run([sys.executable, "-c", FAULTS], capture_output=True, text=True, check=True, timeout=60)
    loose, kept, held = done.stdout.split()
    assert kept == "True"
    pages = 8 * 1_500_000 // 4096
    assert int(held) < 0.1 * pages < int(loose), done.stdout
