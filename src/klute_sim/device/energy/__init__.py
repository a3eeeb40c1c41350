"""Forces, energies and air of a device: ``outputs`` at one instant, ``ledger`` as an energy balance over time."""
