"""Standard uncertainty of every mark: codec, rim, exposure, rigid distance."""
