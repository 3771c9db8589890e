"""The page of a perceptual study: clips one after another, real or not."""

from markupsafe import Markup

from pacmo_core.figures.viewer import environment, part, player_scripts, script_hash

POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; script-src {scripts}"
)


def render_study() -> tuple[str, str]:
    """Write the page, and the policy with which a server must send it."""
    scripts = (*player_scripts(), part("study.js"))
    policy = POLICY.format(scripts=" ".join(f"'{script_hash(script)}'" for script in scripts))
    page = (
        environment()
        .get_template("study.html")
        .render(
            policy=policy,
            style=Markup(part("player.css") + part("study.css")),
            scripts=[Markup(script) for script in scripts],
        )
    )
    return page, policy
