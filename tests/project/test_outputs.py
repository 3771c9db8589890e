"""What is trusted: the files' own names."""

from pathlib import Path

from pacmo_core.project.outputs import ExpectedPriors, unused_prior_outputs

WANTED = ExpectedPriors(["duo"], ["random", "random_6"], ["m_gcn"], [1, 2])
KEPT = [
    "data/priors/splits/.gitignore",
    "data/priors/splits/duo/random.parquet",
    "data/priors/scores/duo/random_6.json",
    "models/priors/duo/random/m_gcn/1/weights.safetensors",
    "models/priors/duo/random/m_gcn/.gitignore",
    "reports/curves/priors/duo/random_6/m_gcn/2.csv",
]
LEFT = {
    "data/priors/samples/cmu/random.parquet": "data/priors/samples/cmu",
    "data/priors/scores/duo/cross_scale.json": "data/priors/scores/duo/cross_scale.json",
    "models/priors/duo/random/m_gcn/3/weights.safetensors": "models/priors/duo/random/m_gcn/3",
    "models/priors/duo/random/f_cnn/1/weights.safetensors": "models/priors/duo/random/f_cnn",
    "reports/curves/priors/duo/random/m_gcn/3.csv": "reports/curves/priors/duo/random/m_gcn/3.csv",
}


def test_priors_that_the_parameters_do_not_make_are_left_over_and_no_others(tmp_path):
    for name in [*KEPT, *LEFT]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = {str(path.relative_to(tmp_path)) for path in unused_prior_outputs(tmp_path, WANTED)}
    assert found == set(LEFT.values())


def test_where_no_priors_are_wanted_all_are_left_over(tmp_path):
    for name in KEPT:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = list(unused_prior_outputs(tmp_path, ExpectedPriors([], [], [], [])))
    assert {path.name for path in found} == {"duo"}
    assert not list(unused_prior_outputs(Path(tmp_path / "nowhere"), WANTED))
