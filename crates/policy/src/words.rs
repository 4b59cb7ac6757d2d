//! Instructions as bags of hashed words.

/// Multi-hot vector of the hashed words and pairs of neighbouring words of an instruction: `buckets` entries of 0 or 1.
/// Letters are converted to lower case; everything but letters and digits separates words.
///
/// ```
/// use genmanip_policy::instruction_words;
/// let words = instruction_words("Put the red mug to the left of the bowl.", 256);
/// assert_eq!(words, instruction_words("put the RED mug to the left of the bowl", 256));
/// assert_ne!(words, instruction_words("Put the bowl to the left of the red mug.", 256));
/// ```
pub fn instruction_words(instruction: &str, buckets: usize) -> Vec<f32> {
    let mut counts = vec![0.0; buckets];
    let lowered = instruction.to_lowercase();
    let words: Vec<&str> =
        lowered.split(|letter: char| !letter.is_alphanumeric()).filter(|it| !it.is_empty()).collect();
    let pairs = words.windows(2).map(|two| two.join(" "));
    for text in words.iter().map(|word| (*word).to_owned()).chain(pairs) {
        if let Some(count) = counts.get_mut(bucket(&text, buckets)) {
            *count = 1.0;
        }
    }
    counts
}

/// FNV-1a, 64 bits, modulo the number of buckets.
fn bucket(text: &str, buckets: usize) -> usize {
    let hash = text
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3));
    (hash % buckets.max(1) as u64) as usize
}
