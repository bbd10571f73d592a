"""The relay: large trainings that go on in leases of a GPU, minutes at a time."""
