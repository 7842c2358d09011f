"""Prior knowledge: V_Vc, its uncertainty, and the device with its K_Vc."""
