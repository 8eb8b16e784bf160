"""Memory that a process has used stays with it, so that large messages do not wait for the kernel.

The C library gives larger pieces of memory back to the kernel as soon as they are free, and gets fresh ones page by
page the next time: at 1 to 2 microseconds a page of 4 KiB on a virtual machine that is half a millisecond for every
copy of a motion of 8 s. Robots' processes keep what they once needed; they need the same again at the next motion.

Source: mallopt(3) of the Linux man-pages.
"""

import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # malloc.h
MOST_KEPT = 256 * 1024 * 1024  # [bytes] free at the end of the heap; several of the largest messages
LARGEST_KEPT = 32 * 1024 * 1024  # [bytes] of one piece; the C library takes no larger threshold


def keep_memory() -> bool:
    """Have this process keep freed memory for its next use; for processes that answer large messages soon.

    Returns:
        Whether the C library does so. Another one than glibc goes on as it was, and large messages take longer.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    return bool(mallopt(M_MMAP_THRESHOLD, LARGEST_KEPT)) and bool(mallopt(M_TRIM_THRESHOLD, MOST_KEPT))
