"""Scale factor, bias and drive frequency over temperature."""
