"""Post-processing of reactions, the finish: bone lengths, foot skate, floor, closed contacts."""
