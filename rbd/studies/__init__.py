"""One problem answered several times: by both laws, by several solvers."""
