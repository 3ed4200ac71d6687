//! Pictures of the same pixels by different samples → their mean. Light is weighted by how many samples each has; data, which
//! have no mean, are those of the part that is nearest; the variance is that of all samples together. Mattes are weighted as
//! light is, thing by thing: a thing that is none of a part's six is taken for none of that part.

use super::MergeError;
use super::pictures::{Part, row_start};
use crate::output::{Channel, Window, cryptomatte, layers::layer_of};

/// How a channel is joined.
#[derive(Clone, Copy, PartialEq)]
enum Rule {
    /// Mean by count of samples.
    Mean,
    /// Of the part with the least Z; of several, the one with the earliest samples.
    Nearest,
    Count,
    Variance,
    /// One of a set of mattes, which are joined together.
    Matte,
}

fn rule(channel: &str) -> Option<Rule> {
    match layer_of(channel).as_str() {
        "samplecount" => Some(Rule::Count),
        "variance" => Some(Rule::Variance),
        "z" | "n" | "p" | "forward" | "backward" | "water" | "velocity" => Some(Rule::Nearest),
        "beauty" | "albedo" | "dnormal" | "mask" | "reflection" | "refraction" | "volume" | "caustics" | "spray"
        | "foam" | "mist" | "terrain" | "sky" => Some(Rule::Mean),
        "cryptoobject" | "cryptomaterial" | "cryptobed" => Some(Rule::Matte),
        layer if layer.starts_with("light_") => Some(Rule::Mean),
        _ => None,
    }
}

/// Joins the pixels of a tile; `parts` in the order of their samples.
pub(super) fn join(parts: &[&Part], window: Window, whole: Window, channels: &mut [Channel]) -> Result<(), MergeError> {
    let unfit = |what: String| MergeError::Unfit { path: parts[0].path.clone(), what };
    let index = |name: &str| channels.iter().position(|channel| channel.name == name);
    let needed = |name: &str| {
        index(name).ok_or_else(|| unfit(format!("has no channel `{name}`; expected it, to join samples by")))
    };
    let rules: Vec<Rule> = channels
        .iter()
        .map(|channel| {
            rule(&channel.name).ok_or_else(|| {
                unfit(format!(
                    "has the channel `{}`, which cannot be joined from pictures of different samples; join the checkpoints \
                     (--keep-checkpoint) instead",
                    channel.name
                ))
            })
        })
        .collect::<Result<_, _>>()?;
    let count = needed("sampleCount")?;
    let depth = if rules.contains(&Rule::Nearest) { Some(needed("Z")?) } else { None };
    let colour = if rules.contains(&Rule::Variance) { Some([needed("R")?, needed("G")?, needed("B")?]) } else { None };
    let variance = index("variance");

    let sets = matte_sets(channels);

    for row in 0..window.height {
        let to = row_start(window, row, whole);
        for column in 0..window.width as usize {
            let value = |part: &Part, channel: usize| {
                let from = row_start(window, row, part.picture.data) + column;
                f64::from(part.picture.channels[channel].samples[from])
            };
            let counts: Vec<f64> = parts.iter().map(|part| value(part, count)).collect();
            let total: f64 = counts.iter().sum();
            let mean = |channel: usize| {
                let sum: f64 = parts.iter().zip(&counts).map(|(part, count)| count * value(part, channel)).sum();
                if total > 0.0 { sum / total } else { 0.0 }
            };
            let nearest = depth.map_or(0, |depth| {
                let mut nearest = 0;
                for (index, part) in parts.iter().enumerate() {
                    // A part that has no sample of the pixel has seen nothing there, not even that nothing is there.
                    if counts[index] > 0.0
                        && (counts[nearest] == 0.0 || value(part, depth) < value(parts[nearest], depth))
                    {
                        nearest = index;
                    }
                }
                nearest
            });
            for (channel, rule) in rules.iter().enumerate() {
                let joined = match rule {
                    Rule::Matte => continue,
                    Rule::Mean => mean(channel),
                    Rule::Nearest => value(parts[nearest], channel),
                    Rule::Count => total,
                    Rule::Variance => {
                        let [r, g, b] = colour.expect("asked for with the rule");
                        let channel = variance.expect("it has the rule");
                        // Rec. 709, as the film weighs its samples.
                        let luminance = |of: &dyn Fn(usize) -> f64| 0.2126 * of(r) + 0.7152 * of(g) + 0.0722 * of(b);
                        let middle = luminance(&mean);
                        let squares: f64 = parts
                            .iter()
                            .zip(&counts)
                            .map(|(part, &count)| {
                                let own = luminance(&|channel| value(part, channel));
                                // The file has the variance of the mean of `count` samples.
                                value(part, channel) * count * (count - 1.0).max(0.0) + count * (own - middle).powi(2)
                            })
                            .sum();
                        if total > 1.0 { squares / (total - 1.0) / total } else { 0.0 }
                    }
                };
                channels[channel].samples[to + column] = joined as f32;
            }
            for set in &sets {
                let shares = parts.iter().zip(&counts).map(|(part, count)| {
                    let share = if total > 0.0 { count / total } else { 0.0 };
                    let ranks = set.chunks_exact(2).map(|pair| (value(part, pair[0]) as f32, value(part, pair[1])));
                    (share, ranks.collect())
                });
                for (channel, joined) in set.iter().zip(matte(shares.collect())) {
                    channels[*channel].samples[to + column] = joined;
                }
            }
        }
    }
    Ok(())
}

/// Places of the channels of each set of mattes that there are: id, coverage, id, coverage ...
fn matte_sets(channels: &[Channel]) -> Vec<Vec<usize>> {
    let place = |name: &String| channels.iter().position(|channel| channel.name == *name);
    let set = |layer: &str| cryptomatte::channels(layer).iter().map(place).collect::<Option<Vec<usize>>>();
    ["CryptoObject", "CryptoMaterial", "CryptoBed"].into_iter().filter_map(set).collect()
}

/// One pixel's ids and coverages out of those of several parts, each with its share of the samples.
fn matte(parts: Vec<(f64, Vec<(f32, f64)>)>) -> Vec<f32> {
    let count = parts.first().map_or(0, |(_, ranks)| ranks.len());
    let mut things: Vec<(u32, f64)> = Vec::new();
    for (share, ranks) in &parts {
        for (id, coverage) in ranks.iter().filter(|(_, coverage)| *coverage > 0.0) {
            let id = id.to_bits();
            match things.iter_mut().find(|thing| thing.0 == id) {
                Some(thing) => thing.1 += share * coverage,
                None => things.push((id, share * coverage)),
            }
        }
    }
    things.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    things.resize(count, (0, 0.0));
    things.into_iter().flat_map(|(id, coverage)| [f32::from_bits(id), coverage as f32]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mattes_are_weighted_thing_by_thing() {
        let [water, rock, spray] = ["water", "rock", "spray"].map(cryptomatte::id);
        let one = vec![(water, 0.75), (rock, 0.25), (0.0, 0.0)];
        let other = vec![(rock, 0.5), (spray, 0.5), (0.0, 0.0)];
        let joined = matte(vec![(0.25, one), (0.75, other)]);
        assert_eq!(joined, [rock, 0.4375, spray, 0.375, water, 0.1875]);
        assert_eq!(matte(vec![(1.0, vec![(0.0, 0.0); 2])]), [0.0; 4]);
    }
}
