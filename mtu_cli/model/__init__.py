"""What a machine is: equations that are linear in unknown functions of position."""
