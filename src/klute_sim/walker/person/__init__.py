"""The body of the walker: muscles and nerves as data, their paths, and the model in MuJoCo."""
