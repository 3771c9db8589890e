"""The registry of models: what is trained, how it is called, and which code trains and reads it.

A further model is a row here, a module of its package and a section of ``params.yaml``. Code is
named by dotted paths, which are imported when they are needed: importing this module does not
import torch.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from torch import Tensor, nn

    from pacmo_core.reaction.windows import ReactionModel
    from pacmo_core.skeleton_prior.settings import PriorConfig
    from pacmo_core.skeleton_prior.vae import SkeletonPrior
    from pacmo_core.training.loop import TrainingData, TrainingLoop

Kind = Literal["reaction", "features", "skeleton_prior"]


@dataclass(frozen=True)
class Model:
    """A kind of model that can be trained.

    Parameters
    ----------
    name : in file paths, tables and the weights' metadata
    label : in reports
    kind : ``reaction`` generates reactions, ``features`` serves the metrics, ``skeleton_prior``
        generates variations on other bodies
    section : of ``params.yaml``
    changes : dotted path of the values that replace some of the section's, of a variant
    settings : ``MODULE:CLASS`` of the section's dataclass
    training : ``MODULE:FUNCTION`` that builds the training loop
    reader : ``MODULE:FUNCTION`` from configuration and weights to the model
    network : of skeleton priors, ``MODULE:FUNCTION`` from ``PriorConfig`` to untrained networks
    uses_actions : whether the training takes the clips' action labels
    multiprocess : whether processes started by torchrun can share its batches
    """

    name: str
    label: str
    kind: Kind
    section: str
    settings: str
    training: str
    reader: str
    network: str = ""
    changes: str = ""
    uses_actions: bool = False
    multiprocess: bool = False

    @property
    def package(self) -> str:
        """Package of ``pacmo_core`` that holds the model's code."""
        return self.training.split(".")[1]

    def settings_class(self) -> type[Any]:
        """Import the dataclass of the model's section of ``params.yaml``."""
        return cast("type[Any]", _import(self.settings))

    def build_training(
        self, data: TrainingData[Any], settings: Any, *, device: str = "cpu", **extra: Any
    ) -> TrainingLoop[Any]:
        """Build the model and the loop that trains it.

        Parameters
        ----------
        data : clips, or examples of a skeleton prior, and what weights are selected on
        settings : of ``settings_class``
        device : of torch
        extra : what this model's training takes besides, such as ``variations``
        """
        if self.uses_actions:
            extra["actions"] = data.train_actions
            extra["validation_actions"] = data.validation_actions
        build = cast("Callable[..., TrainingLoop[Any]]", _import(self.training))
        loop = build(data.train, settings, validation=data.validation, device=device, **extra)
        if self.kind == "reaction":
            fit = cast("Callable[..., None]", _import(_FINISH))
            loop.complete = lambda trained: fit(trained, data)
        return loop

    def read(self, config: Mapping[str, Any], state: Mapping[str, Tensor]) -> nn.Module:
        """Rebuild a trained model from its configuration and weights."""
        return cast("Callable[..., nn.Module]", _import(self.reader))(config, state)


def _reaction(name: str, label: str, settings: str, training: str, **options: Any) -> Model:
    options = {"reader": "generator:generator_from_state", "section": f"train_{name}"} | options
    reader = f"pacmo_core.reaction.{options.pop('reader')}"
    settings = f"pacmo_core.reaction.settings:{settings}"
    training = f"pacmo_core.reaction.{training}"
    kind: Kind = options.pop("kind", "reaction")
    return Model(name, label, kind, options.pop("section"), settings, training, reader, **options)


def _wgan(name: str, label: str, **options: Any) -> Model:
    options = {"training": "wgan:build_training", **options}
    return _reaction(name, label, "PacmoSettings", uses_actions=True, multiprocess=True, **options)


def _variant(name: str, label: str) -> Model:
    """PaCMO with one thing changed: ``train_pacmo_variants.NAME`` over ``train_pacmo``."""
    return _wgan(name, label, section="train_pacmo", changes=f"train_pacmo_variants.{name}")


def _skeleton_prior(name: str, label: str, module: str) -> Model:
    package = "pacmo_core.skeleton_prior"
    return Model(
        name,
        label,
        kind="skeleton_prior",
        section="train_skeleton_prior",
        settings=f"{package}.settings:SkeletonPriorSettings",
        training=f"{package}.training:build_training",
        reader=f"{package}.training:prior_from_state",
        network=f"{package}.{module}:build",
    )


_ROWS = (
    _wgan("pacmo", "PaCMO"),
    _variant("no_critic", "PaCMO without critic"),
    _variant("no_noise", "PaCMO without noise"),
    _variant("no_energy_score", "PaCMO without energy score"),
    _variant("no_body_distances", "PaCMO without distances"),
    _variant("no_contact_score", "PaCMO without contact score"),
    _variant("no_augmentation", "PaCMO without data augmentation"),
    _wgan("pacmo_paper", "PaCMO, as in the paper"),
    _wgan(
        "pacmo_augmented",
        "PaCMO, augmented",
        section="train_pacmo",
        training="variations:build_training",
    ),
    _reaction(
        "regression", "Regression", "RegressionSettings", "baselines:build_regression_training"
    ),
    _reaction(
        "gru",
        "GRU",
        "GruSettings",
        "baselines:build_gru_training",
        reader="baselines:gru_from_state",
    ),
    _reaction(
        "flow_matching",
        "Flow matching",
        "FlowMatchingSettings",
        "flow_matching:build_training",
        reader="flow_matching:flow_generator_from_state",
    ),
    _reaction(
        "autoencoder",
        "Auto-encoder",
        "AutoencoderSettings",
        "autoencoder:build_training",
        kind="features",
        reader="autoencoder:autoencoder_from_state",
    ),
    _reaction(
        "matcher",
        "Matcher",
        "MatcherSettings",
        "matcher:build_training",
        kind="features",
        reader="matcher:matcher_from_state",
    ),
    _skeleton_prior("kinematic", "Kinematic", "kinematic"),
    _skeleton_prior("kinematic_without_start", "Kinematic, without the start", "kinematic"),
    _skeleton_prior("paper", "Paper", "paper"),
    _skeleton_prior("f_cnn", "F-CNN", "paper"),
    _skeleton_prior("f_gcn", "F-GCN", "paper"),
    _skeleton_prior("m_cnn", "M-CNN", "paper"),
    _skeleton_prior("m_gcn", "M-GCN", "paper"),
)
# What is fitted to a trained model of reactions: what its finish knows of contacts and heights.
_FINISH = "pacmo_core.reaction.inference:fit_finish"
# Of constructors and of torch on a configuration or tensors that are not the model's.
_FAULTS = (
    *(KeyError, TypeError, ValueError, AttributeError, IndexError),
    *(RuntimeError, ArithmeticError, MemoryError),
)
MAX_FAULT = 300  # characters; torch lists every tensor
MODELS = {model.name: model for model in _ROWS}


def model_names(kind: Kind) -> tuple[str, ...]:
    """List the models of one kind, in the order of the tables."""
    return tuple(model.name for model in MODELS.values() if model.kind == kind)


def get_model(name: str, kind: Kind) -> Model:
    """Look a model up.

    Raises
    ------
    ValueError
        If there is no such model of that kind; the message lists those there are.
    """
    if name not in model_names(kind):
        raise ValueError(f"model must be one of {', '.join(model_names(kind))}; got {name!r}")
    return MODELS[name]


def load_model(path: Path | str, kind: Kind) -> nn.Module:
    """Read a trained model from its ``weights.safetensors``; nothing is unpickled.

    Raises
    ------
    OSError
        If there is no such file.
    StoreError
        If the file is not whole, or holds no model of this kind.
    """
    # The store reads Parquet too: it is imported when a file is read.
    from pacmo_core.store.files import StoreError  # noqa: PLC0415
    from pacmo_core.store.weights import read_weights  # noqa: PLC0415

    Path(path).stat()  # the system's error names the file, safetensors' does not
    facts, state = read_weights(Path(path))
    name = facts.get("model")
    if name not in model_names(kind):
        raise StoreError(
            f"{path}: wanted a model of {', '.join(model_names(kind))}; got {name!s:.60}"
        )
    try:
        model = MODELS[name].read(facts["config"], state)
        _check_types(model)
        _check_tensors(model, state)
    except _FAULTS as fault:
        text = " ".join(str(fault).split())[:MAX_FAULT]
        raise StoreError(
            f"{path}: a model of another version, to be trained again; differs in {text}"
        ) from fault
    return model


def _check_types(model: nn.Module) -> None:
    """Raise ValueError unless every value of a model's configuration has the type of its field."""
    from pydantic import TypeAdapter  # noqa: PLC0415

    config: Any = model.config
    text = json.dumps(asdict(config), allow_nan=False)
    TypeAdapter(type(config)).validate_json(text, strict=True)


def _check_tensors(model: nn.Module, state: Mapping[str, Tensor]) -> None:
    """Raise ValueError unless the tensors are finite and of the model's types."""
    for name, tensor in model.state_dict().items():
        if state[name].dtype != tensor.dtype:
            raise ValueError(f"tensor {name}: wanted {tensor.dtype}, got {state[name].dtype}")
        if not bool(tensor.isfinite().all()):
            raise ValueError(f"tensor {name}: wanted finite numbers")


def load_reaction_model(path: Path | str) -> ReactionModel:
    """Read a trained model that generates reactions; see ``load_model``."""
    return cast("ReactionModel", load_model(path, "reaction"))


def load_skeleton_prior(path: Path | str) -> SkeletonPrior:
    """Read a trained skeleton prior; see ``load_model``."""
    return cast("SkeletonPrior", load_model(path, "skeleton_prior"))


def build_skeleton_prior(config: PriorConfig) -> SkeletonPrior:
    """Build the untrained networks of the skeleton prior that ``config.model`` names."""
    network = _import(get_model(config.model, "skeleton_prior").network)
    return cast("Callable[[PriorConfig], SkeletonPrior]", network)(config)


def _import(path: str) -> object:
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)
