"""Where the openly downloadable data sets are, and which files belong to them.

SBU Kinect Interaction v2.0 (Yun et al., HAU3D-CVPRW 2012): the data set's own README.txt, which
stands in the same folder, lists the 21 archives of the clean version by these addresses and asks
for research use and a citation. Each archive holds colour and depth pictures besides the
skeletons. Not tried from here: the server may have moved since; ``--base-url`` names a mirror.

CMU Graphics Lab Motion Capture Database: free for research and in products, not to be resold as
data; it asks for the acknowledgement "The data used in this project was obtained from
mocap.cs.cmu.edu. The database was created with funding from NSF EIA-0196217." Addresses follow
the site's own rule, ``subjects/<subject>/<subject>.asf`` and ``<subject>_<trial>.amc``. The counts
of trials are the database index's; a trial that is listed may be absent from the server.
"""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Source:
    """A data set on a web server.

    Parameters
    ----------
    name : what it is fetched by
    folder : its folder under the destination
    base_url : where its files are, without a slash at the end
    parts : what ``--only`` may name
    files : a part's files, relative to ``base_url``
    """

    name: str
    folder: str
    base_url: str
    parts: tuple[str, ...]
    files: Callable[[str], list[str]]


_PAIRS_OF_PEOPLE = """
s01s02 s01s03 s01s07 s02s01 s02s03 s02s06 s02s07 s03s02 s03s04 s03s05 s03s06
s04s02 s04s03 s04s06 s05s02 s05s03 s06s02 s06s03 s06s04 s07s01 s07s03
"""


def _sbu_files(pair: str) -> list[str]:
    return [f"{pair}.zip"]


SBU = Source(
    name="sbu",
    folder="sbu",
    base_url="http://vision.cs.stonybrook.edu/~kiwon/Datasets/SBU_Kinect_Interactions",
    parts=tuple(_PAIRS_OF_PEOPLE.split()),
    files=_sbu_files,
)

# Two subjects recorded together: the same trial number is the same instant.
CMU_PAIRS = (("18", "19"), ("20", "21"), ("22", "23"), ("33", "34"), ("60", "61"))
CMU_TRIALS = {"18": 15, "20": 13, "22": 25, "33": 2, "60": 15}  # of either subject of the pair


def _cmu_files(subject: str) -> list[str]:
    first = next(pair[0] for pair in CMU_PAIRS if subject in pair)
    trials = range(1, CMU_TRIALS[first] + 1)
    names = [f"{subject}.asf", *(f"{subject}_{trial:02d}.amc" for trial in trials)]
    return [f"{subject}/{name}" for name in names]


CMU = Source(
    name="cmu-two-person",
    folder="cmu_two_person",
    base_url="http://mocap.cs.cmu.edu/subjects",
    parts=tuple(subject for pair in CMU_PAIRS for subject in pair),
    files=_cmu_files,
)
