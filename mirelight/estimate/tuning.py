"""What decides the captured light that is found, in one place."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """Shares, angles, counts and weights, each with its unit and what was seen on either side of it.

    Decided on captures whose true light and albedo are known: the scenes of this repository, and those that an
    optimiser made of pictures of a room, a courtyard and a plinth. `docs/benchmarks/truth.md` and `gloss.md` have the
    figures.
    """

    # places and what they face (`transport`)
    place_count: int = 6000  # splats that tell the light
    # from each, to what it faces: the noise of what few rays meet looks smaller under more light
    place_rays: int = 384
    # of a place's rays, as a mean, that should meet the sky: more rays are sent where little of it shows
    place_going_out: int = 48
    place_most_rays: int = 1024  # of one place
    place_shown: int = 60000  # splats that tell what colour a ray meets
    place_agree: int = 9  # of these, nearest ones whose median counts
    # least cosine between a face that a ray meets and that of the nearest splat, if it shows the face
    place_facing: float = 0.5
    place_fewest: int = 200  # splats on the proxy, below which nothing is known
    place_darkest: float = 2e-3  # linear: a darker splat tells little but how it was encoded
    place_most_spread: float = 0.01  # of the diagonal: a splat's axis that counts
    place_light_spp: int = 32  # samples of a light that is known, at each splat: its shadows may be soft
    place_lift: float = 2e-4  # of the diagonal: where rays start

    # how much light comes to what no splat shows (`shade`)
    shade_spp: int = 16  # samples of an even sky's light
    shade_depth: int = 3  # vertices of their paths
    shade_cells: int = 100  # along the diagonal: in cells as small what rays meet gets as much light
    shade_surely: float = 0.7  # of the light at the splats: with less it is darker there; above, it may be noise
    shade_floor: float = 0.01  # of the open sky, added: nothing is black

    # what places share (`around`)
    around_nearest: int = 12  # samples that are looked at for each place
    # of a place's extent: the distance within which others count; as far as shadow edges are left out
    around_reach: float = 3.0
    around_off: float = 0.5  # of a place's extent: how far off the place's plane one may lie
    around_facing: float = 0.95  # least cosine between both planes

    # places taken together (`groups`)
    group_together: int = 4  # places, each counted as one of its own group
    group_looked_at: int = 40  # nearest places, of which those in the plane count
    group_judges: int = 10  # of these, the nearest: what a place sees is compared with the middle of what they see
    group_fewest_judges: int = 4  # in the plane, to judge by
    group_facing: float = 0.9  # least cosine between both planes
    group_off: float = 0.1  # of the distance: how far off the plane
    group_unlike: float = 1.25  # factor between the light of an even sky at a place and around it
    group_albedo: float = 0.35  # by which that sky is as bright as the colours ask for
    group_guessed: float = 0.3  # share of the surfaces that a place faces, beyond which too few are shown by splats
    # share of the places that must be left: in a room seen from inside most of what places face is guessed
    group_least: float = 0.5

    # the fit (`fit`)
    # first neighbours by nearness of each band, and the end of the last
    fit_bands: tuple[int, ...] = (1, 4, 16, 64, 256)
    fit_each: int = 3  # places of each band that a place is paired with
    fit_alike: float = 0.12  # of the logarithm of chroma: how far albedos of one material may differ
    fit_across: float = 0.3  # of the pairs: what those of a place in the sun and one in its shadow count for at least
    fit_most_worth: float = 8.0  # but each no more than so many others
    fit_white_out: float = 0.98  # linear: what shows as bright may have been any brighter
    fit_robust: float = 0.25  # of the logarithm of albedo: beyond, two places are of different material
    fit_white: float = 0.3  # weight of a sun that has sunlight's colour; without, of light that is white in the mean
    fit_dark: float = 0.035  # albedo: the darkest that is likely; and of half of what a sun lights, the darkest at all
    fit_bright: float = 0.7  # albedo: the brightest; blur takes contrast from pictures, and so light
    fit_bounds: float = 0.2  # weight of albedos below the darkest
    # of those above the brightest: with 0.2 light is a sixth too weak on true surfaces of trained captures, with 1
    # right; but then a twelfth too strong on their own proxies, and more on ideal discs, whose colours are too bright
    fit_brights: float = 0.5
    fit_smooth: float = 0.2  # weight of patches that differ from their ring's mean
    # weight of rings above the horizon that differ from the next: a proxy's errors pass for such skies
    fit_steady: float = 0.01
    # times the sun that is found: ground outside may reflect so much, as what a proxy gets wrong makes the sun too
    # weak. With 1 that of a toy yard, behind bars that its proxy lacks, had 0.4 of its strength
    fit_ground_sun: float = 2.0
    # albedo of ground outside, the highest, of the light that is found in the open. With 1 it was as bright as the sky
    # under a street, a park and a plinth, which lit things that are put there from below; 0.25 gives the same light
    fit_ground: float = 0.35
    fit_floor: float = 0.005  # of the mean irradiance, added: nothing is black
    fit_steps: int = 150  # of the descent
    fit_rate: float = 0.06  # of a step, of the logarithm of light
    fit_again: int = 20  # steps after which pairs are weighed anew

    # the sun's search (`sun`)
    sun_directions: int = 5000  # over the whole sphere: 3 degrees apart
    sun_tried: int = 1000  # of these, those of most promise
    sun_starts: int = 3  # of these, that are refined
    sun_starts_apart: float = cos(radians(12.0))  # between two of these
    # suns that edges speak for most, where they tell none surely: what a proxy gets wrong hides one from the search
    sun_voted: int = 8
    sun_voted_radius: float = 0.5  # degrees, that a sun told by edges starts with
    # standard deviations of what edges say, by which they may say less where a sun that they tell is moved to
    sun_said: float = 1.0
    sun_albedos: tuple[float, ...] = (0.2, 0.35, 0.6)  # mean ones that are tried
    # of the sun in the direct light that are tried
    sun_shares: tuple[float, ...] = (0.1, 0.25, 0.45, 0.65, 0.85, 0.95)
    # share of the places that a sun must reach, where it is searched and where it is moved to: of four places in 5644
    # one of 318,000 was found, for 76
    sun_least_lit: float = 0.01
    sun_radii: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0, 4.0, 7.0, 11.0, 16.0)  # degrees, of the disc
    sun_near: int = 3  # radii to either side of the one that a sun was found with, that are compared closely
    sun_blocks: int = 5  # halvings of the places, to blocks whose losses are taken for independent of each other
    sun_surely: float = 2.0  # standard errors, beyond which a radius explains less in truth
    sun_wide: float = 1.0  # of the logarithm of albedo: differences that count in full before light is found
    sun_steps: tuple[float, ...] = (4.0, 2.0, 1.0, 0.5, 0.25)  # degrees, of the refinement
    sun_disc: int = 24  # points of a disc
    sun_few: int = 8  # of a disc that is being moved
    sun_across: float = 1.5  # standard deviations of a splat, out to which the sun is asked for
    # standard deviations of a splat, out to which a proxy's shadow edge may miss the picture's
    sun_around: float = 3.0
    sun_fewest: float = 0.3  # share of places off shadows' edges, at least
    sun_white: float = 0.5  # share of those of them in the sun that show white
    sun_mostly: float = 0.5  # of the sun: a place that sees more of it is lit
    sun_changed: float = 0.02  # of the sun: more of it than that counts as a change
    sun_elsewhere: float = cos(radians(16.0))  # from a sun: nearer ones share most of its shadows

    # its colour: white in the mean of sun and sky made the light of a blue sky and a white sun 1.28 times too yellow
    sun_haze: float = 0.05  # Ångström's coefficient: a clear day
    # air masses of light that shows as white: cameras are set for the sun's light at noon, or for it with the sky's
    sun_white_air: float = 0.5
    sun_most_air: float = 4.0  # of a low sun: cameras take part of its colour away

    # edges of shadows (`edges`)
    # places that edges are looked for between: with a third of them texture hid a sun that all tell
    edge_places: int = 150000
    edge_share: int = 4  # every such one of these is asked about all directions
    edge_bands: tuple[int, ...] = (1, 4, 12, 48)  # first neighbours by nearness of each band, and the end of the last
    edge_each: int = 2  # places of each band that a place is paired with
    edge_plane: float = 0.9  # least cosine between the planes of both
    edge_off: float = 0.3  # of the distance: how far off the other's plane one may lie
    edge_most: float = 0.7  # of the logarithm of luminance: what one pair counts at most
    edge_rays: int = 32  # from each place, that tell how much sky it sees
    # of the sky: how bright surfaces are that hide it; shade that grows towards corners is no shadow's edge
    edge_hidden: float = 0.7
    edge_sure: float = 2.0  # standard deviations by which one sun stands out where edges alone tell it
    # where there is a sun though light explains no more with it: 7 of a plinth whose bushes' shade explains as much, 3
    # where there was one that explains a little
    edge_certain: float = 5.0
    edge_towards: float = 0.1  # least cosine of both towards the sun
    edge_least_cosine: float = 0.02  # below which a place is not lit
    edge_directions: int = 2500  # over the whole sphere: 4 degrees apart
    edge_every: int = 25  # every such one of them is asked about all places, for what directions at random have
    edge_tried: int = 24  # directions that are asked about all places
    edge_refined: int = 4  # of these, that are moved to where edges say most
    edge_fine: int = 40000  # over the whole sphere: 1 degree apart
    edge_around: float = cos(radians(4.5))  # from those that are moved, within which they are tried first
    edge_steps: tuple[float, ...] = (2.0, 1.0, 0.5)  # degrees, of that
    edge_apart: float = cos(radians(6.0))  # between two of these

    # lamps (`lamps`)
    lamp_candidates: int = 2000  # points in the open space that are looked at
    lamp_tried: int = 600  # of these, those of most promise
    lamp_refined: int = 4  # of these, that are moved to where they explain most
    lamp_apart: float = 0.06  # of the places' extent, between those that are refined
    lamp_steps: tuple[float, ...] = (0.04, 0.02, 0.01, 0.005)  # of the places' extent, of the refinement
    lamp_bright: float = 0.05  # share of the places, the brightest: candidates stand before them
    lamp_close: tuple[float, float] = (0.005, 0.1)  # of the extent: how near to them half of the candidates are
    lamp_nearest: float = 0.02  # of the extent: a lamp nearer than this to a place counts as that far from it

    # the light as a whole (`solve`, `which_sun`, `descent`)
    least_open: float = 0.003  # share of the view that must be sky
    least_blocked: float = 0.15  # of the view by other surfaces, below which the scale is not known
    mean_albedo: float = 0.35  # where the scale is not known
    widest_sun: float = 9.0  # degrees, of its radius: what is wider is sky
    # times that places are asked whether proxy and picture agree: after the first the sun is stronger
    agreed: int = 2
    least_gain: float = 0.004  # of the loss by a sun, below which there is none
    sure_gain: float = 0.001  # the same where shadows' edges surely tell one: of glossy things it explains 0.002
    # of the light where it falls, that a sun brings: under clouds a proxy's bumps asked for 0.07; a yard's has 0.55
    least_share: float = 0.15
    # degrees between the suns of both halves, up to which there is one, though its direction be a guess
    no_chance: float = 10.0
    searched: int = 1500  # places of each half that the sun is searched with
    most_lamps: int = 3  # that are looked for
    grouped: float = 0.4  # share of the fit to means in what is found
    robust_grouped: float = 0.18  # as fit_robust: means of places differ less by texture
    # of the loss: a sky that explains places by so much better than a steady one is uneven in truth
    uneven: float = 0.03
    # albedo and the sun's share of the direct light, that a steady sky's fit starts from
    even: tuple[float, float] = (0.35, 0.45)
    lamps_share: float = 0.25  # of the direct light: where a lamp's strength starts from

    # what is doubted (`describe`)
    doubt_halves_agree: float = 0.15  # factor less 1 between the irradiances of both halves
    # degrees between the narrowest and the widest disc, above which its width is a guess
    doubt_disc_known: float = 3.0
    # of the differences: a lamp that explains less may stand for what the proxy gets wrong
    doubt_sure_lamp: float = 0.01
    # standard deviations by which shadows' edges speak for another sun, above which a direction is a guess: below 3
    # where the light as a whole rightly spoke against them
    doubt_beaten: float = 4.0
    # degrees between the suns of both halves, above which it is one, too, unless edges speak for it by as much: 0.5 to
    # 7 of right ones on proxies made of trained splats, 63 of a wrong one
    doubt_apart: float = 20.0
    # of the differences explained elsewhere: hardly any; asked where no shadow has an edge
    doubt_little: float = 0.03
    # of the view that other surfaces take: with less, as beside one wall alone, lamps may be its paint
    doubt_alone: float = 0.01
    # of light from all around, that reaches the captured surface in the mean; less is a room, seen from inside
    doubt_open: float = 0.25

    # gloss (`finish`)
    # that are tried; smoother gloss than this shows in few pixels; what the last one explains best is as good as matt
    gloss_roughnesses: tuple[float, ...] = (0.2, 0.35, 0.5, 0.7, 0.95)
    gloss_most_views: int = 12  # cameras that are compared
    gloss_spp: int = 16  # samples of a lobe
    # share of the changes in the other half, from which a gloss is taken; matt surfaces have 0.02
    gloss_explained: float = 0.1
    gloss_strength: tuple[float, float] = (0.4, 2.5)  # of the lobe that glTF has at the fitted one
    gloss_metal: float = 5.0  # times a dielectric's lobe: what is so much stronger is a metal
    gloss_white: float = 0.9  # linear: pixels that may have been any brighter
    gloss_finest: int = 400  # cells along the size of the mesh, in which pixels of all views are compared
    gloss_regions: int = 24  # of a mesh without materials of its own
    gloss_fewest: int = 200  # pixels of a region
    gloss_places: int = 4096  # of the surface, that regions are told by
    gloss_color: float = 0.12  # display value: colours as far apart are two regions'
    gloss_place: float = 0.35  # share of the size: places as far apart are two regions'


TUNING = Tuning()
