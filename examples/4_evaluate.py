"""Compare the reactions of two models with the captured ones: F²ID, MMD, diversity, APE, AVE."""

import sys

import pacmo_core

n_epochs = int(sys.argv[1]) if len(sys.argv) > 1 else 10
clips = list(pacmo_core.synthesise(80).values())
training, tested = clips[:60], clips[60:]

extractor = pacmo_core.train("autoencoder", training, n_epochs=n_epochs, width=8)
for name in ("regression", "gru"):
    settings = {"hidden": 32} if name == "gru" else {"width": 16}
    model = pacmo_core.train(name, training, n_epochs=n_epochs, **settings)
    reactions = [pacmo_core.react(model, clip)[0] for clip in tested]
    figures = pacmo_core.evaluate(tested, reactions, extractor=extractor)
    print(name, {metric: round(value, 3) for metric, value in figures.items()})
