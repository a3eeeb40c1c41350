"""What the parameter of an effect states, against what a simulation of the device shows."""
