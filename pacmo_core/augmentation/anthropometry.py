"""What is known of human bodies: how long segments are, how tall people are, how they differ.

Segments as shares of stature: Drillis and Contini (1966), *Body segment parameters*, as Winter
(2009), *Biomechanics and motor control of human movement*, figure 4.1, draws them.

Adults: Gordon et al. (2014), *2012 anthropometric survey of U.S. Army personnel* (ANSUR II), which
measured 4,082 men and 1,986 women.

Children: de Onis et al. (2007), *Development of a WHO growth reference for school-aged children and
adolescents*; and, for how long their legs are, the sitting height over stature of Fredriks et al.
(2005), *Nationwide age references for sitting height, leg length, and sitting height/height ratio*
(the fourth Dutch growth study), read off its charts, so to about 0.005.
"""

from dataclasses import dataclass

# Drillis and Contini: shares of stature.
THIGH, SHIN = 0.245, 0.246

# ANSUR II: metres, mean and standard deviation of men's stature.
MEN_STATURE, MEN_STATURE_SPREAD = 1.756, 0.069
# ANSUR II: a standard deviation as a share of the mean, men's upper arms (acromion to radiale).
ARM_SPREAD = 0.05

# WHO 2007: metres, boys of eight years, median; girls' is 7 mm less.
CHILD_STATURE = 1.273
# Fredriks et al.: sitting height over stature.
CHILD_SITTING, ADULT_SITTING = 0.54, 0.52


@dataclass(frozen=True)
class Profile:
    """A body to be had.

    Parameters
    ----------
    stature : metres; None for the source's own
    parts : by which factor parts of the body are longer than stature alone would make them;
        parts that are not named follow stature
    """

    stature: float | None
    parts: dict[str, float]


PROFILES = {
    # Legs are shorter, trunk and head longer, for the same stature.
    "child": Profile(
        CHILD_STATURE,
        {
            "leg": (1 - CHILD_SITTING) / (1 - ADULT_SITTING),
            "trunk": CHILD_SITTING / ADULT_SITTING,
        },
    ),
    # Taller than 97 or 98 men of a hundred.
    "tall_adult": Profile(MEN_STATURE + 2 * MEN_STATURE_SPREAD, {}),
    # Arms longer than those of 97 or 98 of a hundred bodies of that stature.
    "long_arms": Profile(None, {"arm": 1 + 2 * ARM_SPREAD}),
}
