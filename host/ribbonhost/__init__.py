"""Host side of the sensor ribbon: from packets to curves and a surface."""
