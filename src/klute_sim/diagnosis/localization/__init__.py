"""Where the misfit is: channels, conditions, and equations that measured channels can check."""
