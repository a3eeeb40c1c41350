"""MuJoCo: load a model, bind a device to one of its actuators, install the law around stepping, step."""
