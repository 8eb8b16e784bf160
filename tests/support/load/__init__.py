"""The suite on a machine that is busy and stalls: `python -m tests.support.load` runs it so and prints figures.

Processes of its own making are found, stopped, woken and ended here (`processes`), stalled by a drawn plan (`stalls`),
and counted (`report_plugin`). A test that stops a process itself does so through `freezing`, so that the load tool does
not wake it.
"""
