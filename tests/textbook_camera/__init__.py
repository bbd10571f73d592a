"""A video snapshot compressive imaging camera from the optics textbook, written apart from the program that it tests.

Nothing here imports the package: a diagnosis of these captures is tested by a second physics. ``camera`` lists the
parts and the plan of captures; ``targets``, ``light`` and ``sensor`` are the physics, in the order of the light;
``recording`` writes a file; ``vocabulary`` converts the contract's words; ``suite`` draws sealed rounds.
"""
