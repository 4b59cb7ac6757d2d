"""Makes the environments known to Gymnasium, where it is installed."""

ID = "GenManip-v0"


def register():
    """Registers them; without Gymnasium the rest of the package works all the same."""
    try:
        import gymnasium
    except ModuleNotFoundError:
        return
    if ID not in gymnasium.registry:
        names = {"entry_point": "genmanip.gym:GenManipEnv", "vector_entry_point": "genmanip.gym:GenManipVectorEnv"}
        gymnasium.register(ID, order_enforce=True, disable_env_checker=True, **names)
