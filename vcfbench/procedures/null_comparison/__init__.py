"""V_Vc and table compared at equal outputs, at rates of both signs."""
