"""The finish of a reaction, a rule after the network: exact bones, still feet, closed contacts."""
