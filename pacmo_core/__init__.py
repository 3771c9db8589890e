"""Two-person motion: generate the reaction to a partner, retarget both people to other bodies.

    import pacmo_core

    walk = pacmo_core.load_person("walk.bvh")
    (reaction,) = pacmo_core.react(None, walk)    # by the weights in the package

    clips = pacmo_core.synthesise(20)
    model = pacmo_core.train("regression", clips, n_epochs=10)
    captured = clips["handshake-1"]
    (reaction,) = pacmo_core.react(model, captured)
    pacmo_core.view({"captured": captured, "generated": reaction}, "view.html")

Functions are imported when they are first used, so that ``import pacmo_core`` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pacmo_core.api import (
        default_settings,
        evaluate,
        load_clips,
        load_person,
        react,
        retarget,
        save,
        synthesise,
        train,
        view,
    )
    from pacmo_core.data.interaction import Interaction
    from pacmo_core.data.skeleton import Skeleton

__all__ = [
    "Interaction",
    "Skeleton",
    "default_settings",
    "evaluate",
    "load_clips",
    "load_person",
    "react",
    "retarget",
    "save",
    "synthesise",
    "train",
    "view",
]
_MODULES = {"Interaction": "data.interaction", "Skeleton": "data.skeleton"}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module pacmo_core has no attribute {name!r}")
    module = import_module(f"pacmo_core.{_MODULES.get(name, 'api')}")
    return getattr(module, name)


def __dir__() -> list[str]:
    return __all__
