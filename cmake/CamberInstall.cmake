# Filled by the packaging work: export of camber:: targets.
