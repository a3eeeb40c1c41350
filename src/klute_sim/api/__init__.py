"""Public functions and their results: one module per task, shared by Python users and the command line."""
