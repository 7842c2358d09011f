"""What is known beforehand: V_Vc, how well, and the device with its K_Vc."""
