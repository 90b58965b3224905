"""Where and how samples are evaluated: functions checked and sent, chunks, processes, executors, Ctrl-C, progress."""
