"""The static record: output at rest, Allan deviation, noise coefficients, bias stability."""
